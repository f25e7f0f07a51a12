#include "mpm_hpc/fields/field_set.hpp"

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
    if (columns_[f].traits.name == name) return f;
  return no_field;
}

void FieldSet::resize(Index size) {
  for (Column& column : columns_) {
    const std::size_t width = bytes_of(column.traits.type);
    const std::size_t needed = width * static_cast<std::size_t>(size);
    for (int c = 0; c < column.traits.components; ++c) {
      AlignedBuffer& buffer = column.components[c];
      if (!buffer.data() || needed > buffer.capacity()) {
        // A little slack, so that a few arriving particles don't reallocate every column.
        AlignedBuffer larger(needed + needed / 32, (column.first_stagger + c) * stagger_step);
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
void gather_component(const void* from, void* to, const std::vector<Index>& source) {
  const T* in = static_cast<const T*>(from);
  T* out = static_cast<T*>(to);
  for (std::size_t i = 0; i < source.size(); ++i) out[i] = in[source[i]];
}

}  // namespace

void FieldSet::gather(const std::vector<Index>& source) {
  for (Column& column : columns_) {
    const int width = bytes_of(column.traits.type);
    for (int c = 0; c < column.traits.components; ++c) {
      AlignedBuffer& buffer = column.components[c];
      spare_.allocate(width * source.size(), (column.first_stagger + c) * stagger_step);
      if (width == 4) {
        gather_component<std::uint32_t>(buffer.data(), spare_.data(), source);
      } else {
        gather_component<std::uint64_t>(buffer.data(), spare_.data(), source);
      }
      buffer.swap(spare_);
    }
  }
  size_ = static_cast<Index>(source.size());
}

int FieldSet::bytes_per_particle() const {
  int bytes = 0;
  for (const Column& column : columns_) bytes += column.traits.components * bytes_of(column.traits.type);
  return bytes;
}

std::size_t FieldSet::allocated_bytes() const {
  std::size_t bytes = spare_.allocated();
  for (const Column& column : columns_)
    for (const AlignedBuffer& buffer : column.components) bytes += buffer.allocated();
  return bytes;
}

void FieldSet::pack(const std::vector<Index>& particles, std::vector<char>& out) const {
  const std::size_t start = out.size(), stride = bytes_per_particle();
  out.resize(start + stride * particles.size());
  std::size_t offset = start;
  for (const Column& column : columns_) {
    const int width = bytes_of(column.traits.type);
    for (const AlignedBuffer& buffer : column.components) {
      const char* in = static_cast<const char*>(buffer.data());
      for (std::size_t i = 0; i < particles.size(); ++i)
        std::memcpy(&out[offset + i * stride], in + static_cast<std::size_t>(particles[i]) * width, width);
      offset += width;
    }
  }
}

void FieldSet::unpack(const char* in, Index first, Index count) {
  const std::size_t stride = bytes_per_particle();
  std::size_t offset = 0;
  for (Column& column : columns_) {
    const int width = bytes_of(column.traits.type);
    for (AlignedBuffer& buffer : column.components) {
      char* out = static_cast<char*>(buffer.data()) + static_cast<std::size_t>(first) * width;
      for (Index i = 0; i < count; ++i)
        std::memcpy(out + static_cast<std::size_t>(i) * width, in + offset + i * stride, width);
      offset += width;
    }
  }
}

}  // namespace mpm
