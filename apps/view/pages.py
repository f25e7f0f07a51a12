"""Pictures, contact sheets and animations."""
import shutil
import subprocess
import sys

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.ticker import MaxNLocator
from PIL import Image

from view.frames import si_prefix
from view.projections import PlaneView

plt.rcParams.update({"font.size": 13, "axes.titlesize": 15, "axes.labelsize": 14, "axes.linewidth": 0.8,
                     "legend.frameon": False, "legend.fontsize": 11, "figure.max_open_warning": 0})


class Page:
    """A figure laid out in hundredths of an inch, so that text keeps its share of the page at any --size."""

    def __init__(self, width, height, dpi=100):
        self.width, self.height, self.dpi = width, height, dpi
        self.figure = plt.figure(figsize=(width / 100, height / 100), dpi=dpi)

    def pixels(self, length):
        return max(2, int(round(length * self.dpi / 100)))

    def axes(self, left, bottom, width, height):
        """Axes on whole pixels, so that a rendered image is shown pixel by pixel."""
        across, up = np.round(self.figure.get_size_inches() * self.dpi)
        return self.figure.add_axes([self.pixels(left) / across, self.pixels(bottom) / up,
                                     self.pixels(width) / across, self.pixels(height) / up])

    def text(self, x, y, words, **options):
        self.figure.text(x / self.width, y / self.height, words, **options)

    def image(self, view, particles, left, bottom, size, extent=None):
        axes = self.axes(left, bottom, *size)
        image = view.render(*particles, self.pixels(size[0]), self.pixels(size[1]))
        image = (image * 255 + 0.5).astype(np.uint8)
        axes.imshow(image, extent=extent, interpolation="nearest", aspect="auto")
        return axes

    def scale_bar(self, view, image_width, left, bottom):
        """A bar of a round length, at most a seventh of the image, with the length beside it."""
        power = 10 ** np.floor(np.log10(view.extent[0] / 7))
        length = power * max(step for step in (1, 2, 5) if step * power <= view.extent[0] / 7)
        factor, unit = si_prefix(length, "m")
        end = left + length / view.extent[0] * image_width
        self.figure.add_artist(plt.Line2D([left / self.width, end / self.width], [bottom / self.height] * 2,
                                          color="black", linewidth=3, solid_capstyle="butt"))
        self.text(end + 10, bottom, f"{length * factor:g} {unit}", va="center")

    def save(self, path, most_bytes=np.inf):
        """Writes the page, with 255 colours only if it would take more than `most_bytes` in full colour."""
        self.figure.canvas.draw()
        image = Image.fromarray(np.asarray(self.figure.canvas.buffer_rgba())[:, :, :3])
        plt.close(self.figure)
        image.save(path, optimize=True)
        if path.stat().st_size > most_bytes:
            image.quantize(255, Image.Quantize.MAXCOVERAGE, kmeans=1, dither=Image.Dither.NONE).save(
                path, optimize=True)
        print(f"wrote {path}")


def draw_triad(axes, view):
    axes.set(xlim=(-1.5, 1.5), ylim=(-1.5, 1.5))
    axes.axis("off")
    for number in np.argsort(view.axes[2]):  # the axis that points at the eye comes last
        tip, colour = view.axes[:2, number], ("#c0392b", "#2e8b57", "#2c6fbb")[number]
        axes.annotate("", tip, (0, 0), arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 2,
                                                   "shrinkA": 0, "shrinkB": 0})
        length = np.linalg.norm(tip)
        label = tip * (1 + 0.28 / length) if length > 0.1 else np.array([-0.28, -0.28])
        axes.text(*label, "xyz"[number], color=colour, ha="center", va="center")


def draw_picture(path, view, size, title, particles, colours):
    left, right, bottom, top = 110, 165, 90, 60
    borders = np.array([left + right, bottom + top])
    whole = np.array([1200, 1200 * size[1] / size[0]]) if size else np.array([1200, 1000])
    image = view.extent * ((whole - borders) / view.extent).min()
    if not size:
        whole = np.maximum(image + borders, (760, 460))
    page = Page(*whole, dpi=size[0] / 12 if size else 100)
    x, y = (whole - borders - image) / 2 + (left, bottom)
    if isinstance(view, PlaneView):
        factor, unit = si_prefix(np.abs([view.low, view.high]).max(), "m")
        axes = page.image(view, particles, x, y, image, np.stack([view.low, view.high], 1).ravel() * factor)
        axes.set(xlabel=f"x [{unit}]", ylabel=f"y [{unit}]")
        for axis, length in ((axes.xaxis, image[0]), (axes.yaxis, image[1])):
            axis.set_major_locator(MaxNLocator(int(np.clip(length / 70, 2, 9)), steps=[1, 2, 5, 10]))
    else:
        page.image(view, particles, x, y, image).axis("off")
        draw_triad(page.axes(10, 10, 130, 130), view)
        if np.isinf(view.distance):
            page.scale_bar(view, image[0], 170, 40)
    page.text(x + image[0] / 2, y + image[1] + 20, title, ha="center", fontsize=15)
    bar = max(image[1], min(260, 0.6 * whole[1]))
    colours.draw_bar(page.axes(x + image[0] + 30, y + (image[1] - bar) / 2, 22, bar))
    page.save(path)


def draw_contact_sheet(path, view, size, title, panels, colours, curves=None):
    """`panels`: a list of (caption, particles); `curves(page)` draws into the lowest 300 of the page; of `size` only the
    width counts."""
    right, top, bottom, gap, caption = 130, 50, 55 + (300 if curves else 0), 16, 30

    def layout(columns):
        width = (1400 - right - 20 - gap * (columns - 1)) / columns
        image = width * np.array([1, view.extent[1] / view.extent[0]])
        return columns, image, top + bottom + -(-len(panels) // columns) * (image[1] + caption)
    sheets = map(layout, range(1, len(panels) + 1))
    columns, image, height = min(sheets, key=lambda sheet: abs(np.log(sheet[2] / 950)))
    page = Page(1400, height, dpi=size[0] / 14 if size else 100)
    for number, (label, particles) in enumerate(panels):
        x = 20 + number % columns * (image[0] + gap)
        y = height - top - (number // columns + 1) * (image[1] + caption)
        axes = page.image(view, particles, x, y, image)
        axes.set(xticks=[], yticks=[])
        axes.spines[:].set_visible(isinstance(view, PlaneView))
        page.text(x + image[0] / 2, y + image[1] + 5, label, ha="center")
    page.text(20, height - 34, title, fontsize=15)
    page.scale_bar(view, image[0], 20, bottom - 30)
    if curves:
        curves(page)
    room = height - top - bottom - caption
    bar = min(room, 500)
    colours.draw_bar(page.axes(1400 - right + 15, bottom + (room - bar) / 2, 22, bar))
    page.save(path, most_bytes=150e3)


def write_animation(folder, pictures):
    """A GIF of at most 120 pictures and 8 MB, and an MP4 of all where ffmpeg is installed."""
    chosen = [pictures[i] for i in np.unique(np.linspace(0, len(pictures) - 1, 120).round().astype(int))]
    path, width = folder / "animation.gif", 800
    while True:
        images = []
        for picture in chosen:
            with Image.open(picture) as image:
                images.append(image.convert("RGB").resize((width, round(image.height * width / image.width)),
                                                          Image.Resampling.LANCZOS))
        sample = np.concatenate([np.asarray(images[i]) for i in (0, len(images) // 2, -1)])
        palette = Image.fromarray(sample).quantize(255, Image.Quantize.MEDIANCUT)
        images = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
        images[0].save(path, save_all=True, append_images=images[1:], loop=0, optimize=False,
                       duration=[100] * (len(images) - 1) + [1500])
        if path.stat().st_size < 8e6 or width < 300:
            break
        width = int(0.75 * width)
    print(f"wrote {path}")
    if shutil.which("ffmpeg"):
        movie = folder / "animation.mp4"
        command = ["ffmpeg", "-y", "-loglevel", "error", "-f", "image2pipe", "-framerate", "12", "-i", "-",
                   "-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p", str(movie)]
        stream = b"".join(picture.read_bytes() for picture in pictures)
        if subprocess.run(command, input=stream, check=False).returncode == 0:
            print(f"wrote {movie}")
        else:
            print(f"mpm_view: ffmpeg could not write {movie}", file=sys.stderr)
