"""Particles to pixels, in the plane and in space."""
import numpy as np

FILL = 1.15  # squares are drawn this much larger than the particle spacing, so that stretch opens no holes


def particle_sizes(points, fields, spacing, dimension):
    """Edges (n x dimension) [m]: the volume gives their product, a deformation gradient their ratio."""
    edge = np.full(len(points), spacing)
    if "volume" in fields:
        edge = fields["volume"][:, 0].astype(float) ** (1 / dimension)
    sizes = np.repeat(edge[:, None], dimension, axis=1)
    if "deformation_gradient" in fields:
        gradient = fields["deformation_gradient"].astype(float)
        side = 2 if gradient.shape[1] == 4 else 3
        gradient = gradient.reshape(-1, side, side)[:, :dimension, :dimension]
        shape = np.sqrt(np.square(gradient).sum(2))
        shape /= np.maximum(np.prod(shape, axis=1, keepdims=True), 1e-12) ** (1 / dimension)
        sizes *= np.clip(shape, 0.5, 2.0)  # broken particles may be stretched without bound
    return sizes


def count_spacing(points, dimension):
    """Particle spacing [m] from the median number of particles in occupied cells, four spacings wide."""
    places = points[:, :dimension] - points[:, :dimension].min(0)
    places = places[:, np.ptp(places, axis=0) > 0]
    if places.size == 0:
        return 1.0
    spacing = np.prod(np.ptp(places, axis=0) / len(places) ** (1 / places.shape[1])) ** (1 / places.shape[1])
    for _ in range(4):
        cells = np.floor(places / (4 * spacing)).astype(np.int64)
        _, counts = np.unique(np.ravel_multi_index(cells.T, cells.max(0) + 1), return_counts=True)
        spacing *= 4 / np.median(counts) ** (1 / places.shape[1])
    return float(spacing)


class PlaneView:
    """A plane picture: a pixel averages over the areas of the squares that cover it, so without moire."""

    def __init__(self, low, high, margin):
        self.low, self.high = low[:2] - margin, high[:2] + margin
        self.extent = self.high - self.low

    def render(self, points, sizes, colours, width, height):
        scale = np.array([width, height]) / self.extent
        total = np.zeros((4, width * height))
        parts = int(np.ceil((sizes * scale).max(initial=1) * FILL / 4))  # big squares are split: short loops
        offsets = (np.arange(parts) + 0.5) / parts - 0.5
        for start in range(0, len(points), 500_000):
            chunk = slice(start, start + 500_000)
            edge = FILL * sizes[chunk] * scale
            centre = (points[chunk, :2] - self.low) * scale
            for x in offsets:
                for y in offsets:
                    self._cover(total, centre + edge * (x, y), edge / parts, colours[chunk], width, height)
        weight = total[3]
        alpha = np.minimum(weight, 1)
        image = 1 - alpha + alpha * total[:3] / np.where(weight > 0, weight, 1)
        return image.T.reshape(height, width, 3)[::-1]

    @staticmethod
    def _cover(total, centre, edge, colours, width, height):
        low, high = centre - edge / 2, centre + edge / 2
        first = np.floor(low).astype(np.int64)
        reach = np.ceil((high - first).max(axis=0, initial=0)).astype(int)
        for j in range(reach[1]):
            row = first[:, 1] + j
            covered_y = np.minimum(high[:, 1], row + 1) - np.maximum(low[:, 1], row)
            for i in range(reach[0]):
                column = first[:, 0] + i
                covered = (np.minimum(high[:, 0], column + 1) - np.maximum(low[:, 0], column)).clip(0)
                covered *= covered_y.clip(0)
                seen = (covered > 0) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
                pixel, part = (row * width + column)[seen], covered[seen]
                for channel in range(4):
                    weights = part if channel == 3 else part * colours[seen, channel]
                    total[channel] += np.bincount(pixel, weights, total.shape[1])


class SpaceView:
    """A space picture: z-buffered spheres, lit by the surface normal of the smoothed particle density."""
    samples = 2  # pixels per direction and final pixel

    def __init__(self, low, high, margin, angles, perspective):
        azimuth, elevation = np.radians(angles)
        right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        eye = np.array([*(np.cos(elevation) * np.array([right[1], -right[0]])), np.sin(elevation)])
        self.axes = np.array([right, np.cross(eye, right), eye])  # rows: right, up, towards the eye
        self.centre = (low + high) / 2
        self.distance = 2.5 * np.linalg.norm(high - low) if perspective else np.inf
        corners = np.stack(np.meshgrid(*zip(low, high)), -1).reshape(-1, 3)
        position, _ = self._project(corners)
        self.low, self.high = position[:, :2].min(0) - margin, position[:, :2].max(0) + margin
        self.extent = self.high - self.low

    def _project(self, points):
        position = (points - self.centre) @ self.axes.T
        enlarged = 1 / (1 - position[:, 2] / self.distance)
        position[:, :2] *= enlarged[:, None]
        return position, enlarged

    def render(self, points, sizes, colours, width, height):
        width, height = width * self.samples, height * self.samples
        image = np.ones((height * width, 3), np.float32)
        if len(points):  # a run may lose all
            self._splat(image, points, sizes.mean(1), colours, width, height)
        image = image.reshape(height // self.samples, self.samples, width // self.samples, self.samples, 3)
        return image.mean(axis=(1, 3))[::-1]

    def _splat(self, image, points, sizes, colours, width, height):
        position, enlarged = self._project(points)
        scale = width / self.extent[0]
        radius = 0.8 * sizes * enlarged * scale  # more than sqrt(1/2): a square layer of spheres has no holes
        position[:, :2] = (position[:, :2] - self.low) * scale
        position[:, 2] *= scale
        front = self._front(position, radius, width, height)
        if not len(front):  # all are out of sight
            return
        normal, openness = surface_light(points, front, float(np.median(sizes)), self.axes[2])
        normal = normal @ self.axes.T
        x, y, z = position[front].T
        radius = radius[front]
        column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
        depth = np.full(width * height, -np.inf)
        nearest = np.full(width * height, -1)
        reach = int(np.ceil(radius.max()))
        for j in range(-reach, reach + 1):
            for i in range(-reach, reach + 1):
                if i * i + j * j > (reach + 1.5) ** 2:
                    continue
                gap = radius ** 2 - (column + i + 0.5 - x) ** 2 - (row + j + 0.5 - y) ** 2
                seen = np.flatnonzero((gap > 0) & (column + i >= 0) & (column + i < width)
                                      & (row + j >= 0) & (row + j < height))
                pixel = (row[seen] + j) * width + column[seen] + i
                top = z[seen] + np.sqrt(gap[seen])
                nearer = top > depth[pixel]
                pixel, seen = pixel[nearer], seen[nearer]
                depth[pixel] = top[nearer]  # back to front, so that the nearest of equal pixels stays
                nearest[pixel] = seen
        filled = np.flatnonzero(nearest >= 0)
        owner = nearest[filled]
        offset = np.stack([filled % width + 0.5 - x[owner], filled // width + 0.5 - y[owner]], 1)
        roundness = np.clip(0.04 * (np.median(radius) / self.samples - 4), 0, 0.25)  # only where spheres show
        bent = normal[owner]
        bent[:, :2] += roundness * offset / radius[owner, None]
        bent /= np.linalg.norm(bent, axis=1, keepdims=True)
        key = np.array([-0.45, 0.65, 0.61])  # from above and left of the eye
        light = 0.42 + 0.50 * np.clip(bent @ key, 0, None) + 0.22 * np.clip(bent[:, 2], 0, None)
        image[filled] = np.clip(colours[front][owner] * (light * openness[owner])[:, None], 0, 1)

    @staticmethod
    def _front(position, radius, width, height):
        """Indices of the particles that can be seen, back to front."""
        cell = 1.25 * np.median(radius)
        shape = (int(height / cell) + 3, int(width / cell) + 3)
        outside = (position[:, :2] < -radius[:, None]) | (position[:, :2] > (width, height) + radius[:, None])
        order = np.flatnonzero(~outside.any(1))
        order = order[np.argsort(position[order, 2], kind="stable")]
        places = np.floor(position[order, :2] / cell).astype(int) + 1
        column, row = places.clip(0, (shape[1] - 1, shape[0] - 1)).T
        nearest = np.full(shape, -np.inf)
        nearest[row, column] = position[order, 2]
        padded = np.pad(nearest, 1, constant_values=-np.inf)
        lowest = np.min([padded[j:j + shape[0], i:i + shape[1]] for j in range(3) for i in range(3)], axis=0)
        return order[position[order, 2] > lowest[row, column] - 4 * radius[order]]


def surface_light(points, visible, spacing, towards_eye):
    """Normals of the smoothed particle density, and how open the space above each visible particle is."""
    low, extent = points.min(0), np.ptp(points, axis=0)
    cell = max(1.5 * spacing, (np.prod(extent + 12 * spacing) / 8e6) ** (1 / 3))  # at most some 8 M cells
    origin = low - 6 * cell
    shape = np.ceil(extent / cell).astype(int) + 13
    strides = np.array([shape[1] * shape[2], shape[2], 1])
    corners = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1]), -1).reshape(-1, 3)

    def stencil(places):
        scaled = (places - origin) / cell
        base = np.clip(np.floor(scaled), 0, shape - 2).astype(np.int64)
        part = scaled - base
        for corner in corners:
            yield base @ strides + corner @ strides, np.prod(np.where(corner, part, 1 - part), axis=1)

    def smooth(grid):
        for axis in range(3):
            grid = (np.roll(grid, 1, axis) + grid + np.roll(grid, -1, axis)) / 3  # the empty rim wraps round
        return grid

    density = sum(np.bincount(index, weight, int(np.prod(shape))) for index, weight in stencil(points))
    density = smooth(density.reshape(shape)) * (spacing / cell) ** 3  # about 1 inside the material
    gradient = np.stack(np.gradient(density), -1).reshape(-1, 3)
    places = points[visible]
    normal = -sum(gradient[index] * weight[:, None] for index, weight in stencil(places)) + 0.02 * towards_eye
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    wide = smooth(smooth(density)).ravel()
    above = sum(wide[index] * weight for index, weight in stencil(places + 3.5 * cell * normal))
    return normal, 1 - 0.6 * np.clip(above, 0, 1)
