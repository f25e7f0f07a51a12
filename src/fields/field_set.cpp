#include "mpm_hpc/fields/field_set.hpp"

#include <algorithm>
#include <cstring>

#include "mpm_hpc/base/error.hpp"

namespace mpm {

FieldId FieldSet::add(const FieldTraits& traits) {
  debug_check(find(traits.name) == no_field, "a particle field is declared twice");
  debug_check(size_ == 0, "particle fields are declared before particles exist");
  Column column{traits, {}, component_count_};
  column.components.resize(traits.components);
  component_count_ += traits.components;
  columns_.push_back(std::move(column));
  return count() - 1;
}

FieldId FieldSet::find(std::string_view name) const {
  for (int f = 0; f < count(); ++f)
    if (columns_[f].traits.name == name && has(f)) return f;
  return no_field;
}

void FieldSet::resize(Index size) {
  for (Column& column : columns_) {
    const std::size_t width = bytes_of(column.traits.type);
    const std::size_t needed = width * static_cast<std::size_t>(size);
    for (int c = 0; c < column.traits.components; ++c) {
      AlignedBuffer& buffer = column.components[c];
      if (!buffer.data() || needed > buffer.capacity()) {
        const std::size_t room = buffer.data() ? needed / AlignedBuffer::growing : 0;
        AlignedBuffer larger(needed + room, (column.first_stagger + c) * stagger_step);
        if (size_ > 0) std::memcpy(larger.data(), buffer.data(), width * static_cast<std::size_t>(size_));
        buffer.swap(larger);
      }
      buffer.fence(needed);
    }
  }
  size_ = size;
}

namespace {

template <class T>
void gather_component(const void* from, void* to, std::span<const Index> source) {
  const T* in = static_cast<const T*>(from);
  T* out = static_cast<T*>(to);
  for (std::size_t i = 0; i < source.size(); ++i) out[i] = in[source[i]];
}

// Values of some particles into every stride-th byte from `out` on, and back.
template <class Word>
void pack_component(const void* from, std::span<const Index> particles, char* out, std::size_t stride) {
  const Word* in = static_cast<const Word*>(from);
  for (std::size_t i = 0; i < particles.size(); ++i) std::memcpy(out + i * stride, &in[particles[i]], sizeof(Word));
}
template <class Word>
void unpack_component(const char* in, std::size_t stride, std::span<const Index> particles, void* to) {
  Word* out = static_cast<Word*>(to);
  for (std::size_t i = 0; i < particles.size(); ++i) std::memcpy(&out[particles[i]], in + i * stride, sizeof(Word));
}

// Calls f(block, number of its first particle) for few particles at a time, whose packed bytes stay in the cache while
// component after component is copied.
template <class F>
void for_blocks(std::span<const Index> particles, F&& f) {
  constexpr std::size_t block = 256;
  for (std::size_t first = 0; first < particles.size(); first += block)
    f(particles.subspan(first, std::min(block, particles.size() - first)), first);
}

}  // namespace

void FieldSet::gather(std::span<const Index> source) {
  for (Column& column : columns_) {
    const int width = bytes_of(column.traits.type);
    for (int c = 0; c < column.traits.components; ++c) {
      AlignedBuffer& buffer = column.components[c];
      AlignedBuffer& spare = spare_[width == 8];
      spare.allocate(width * source.size(), (column.first_stagger + c) * stagger_step);
      if (width == 4) {
        gather_component<std::uint32_t>(buffer.data(), spare.data(), source);
      } else {
        gather_component<std::uint64_t>(buffer.data(), spare.data(), source);
      }
      buffer.swap(spare);
    }
  }
  size_ = static_cast<Index>(source.size());
}

int FieldSet::bytes_per_particle() const {
  int bytes = 0;
  for (const Column& column : columns_) bytes += column.traits.components * bytes_of(column.traits.type);
  return bytes;
}

std::size_t FieldSet::allocated_bytes(FieldId f) const {
  std::size_t bytes = 0;
  for (const AlignedBuffer& buffer : columns_[f].components) bytes += buffer.allocated();
  return bytes;
}

void FieldSet::pack(std::span<const Index> particles, std::vector<char>& out) const {
  const std::size_t start = out.size(), stride = bytes_per_particle();
  out.resize(start + stride * particles.size());
  for_blocks(particles, [&](std::span<const Index> block, std::size_t first) {
    std::size_t offset = start + first * stride;
    for (const Column& column : columns_) {
      const std::size_t width = bytes_of(column.traits.type);
      const auto pack_values = width == 4 ? pack_component<std::uint32_t> : pack_component<std::uint64_t>;
      for (const AlignedBuffer& buffer : column.components) {
        pack_values(buffer.data(), block, &out[offset], stride);
        offset += width;
      }
    }
  });
}

void FieldSet::unpack(const char* in, std::span<const Index> particles) {
  const std::size_t stride = bytes_per_particle();
  for_blocks(particles, [&](std::span<const Index> block, std::size_t first) {
    std::size_t offset = first * stride;
    for (const Column& column : columns_) {
      const std::size_t width = bytes_of(column.traits.type);
      const auto unpack_values = width == 4 ? unpack_component<std::uint32_t> : unpack_component<std::uint64_t>;
      for (const AlignedBuffer& buffer : column.components) {
        unpack_values(in + offset, stride, block, buffer.data());
        offset += width;
      }
    }
  });
}

}  // namespace mpm
