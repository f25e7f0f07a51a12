#include "mpm_hpc/parallel/communicator.hpp"

#include <algorithm>
#include <cstdlib>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/parallel/mpi_handle.hpp"

namespace mpm {

namespace {

void add_compensated(void* in, void* inout, int* count, MPI_Datatype*) {
  const CompensatedSum* a = static_cast<const CompensatedSum*>(in);
  CompensatedSum* b = static_cast<CompensatedSum*>(inout);
  for (int i = 0; i < *count; ++i) {
    b[i].add(a[i].high);
    b[i].low += a[i].low;
  }
}

constexpr int exchange_tag = 64;  // and 65: neighbouring rounds must not mix

template <class Handle, class T>
T reduce(Handle& handle, T value, MPI_Datatype type, MPI_Op op) {
  T result;
  ++handle.collectives;
  MPI_Allreduce(&value, &result, 1, type, op, handle.comm);
  return result;
}

template <class Handle, class T>
void reduce(Handle& handle, std::vector<T>& values, MPI_Datatype type, MPI_Op op) {
  ++handle.collectives;
  MPI_Allreduce(MPI_IN_PLACE, values.data(), static_cast<int>(values.size()), type, op, handle.comm);
}

}  // namespace

Communicator Communicator::world() {
  Communicator c;
  c.handle_ = std::make_shared<Handle>();
  c.handle_->comm = MPI_COMM_WORLD;
  // A pair of doubles as one MPI element: MPI may cut a message between elements only.
  static_assert(sizeof(CompensatedSum) == 2 * sizeof(Real));
  MPI_Type_contiguous(2, MPI_DOUBLE, &c.handle_->sum_pair);
  MPI_Type_commit(&c.handle_->sum_pair);
  MPI_Op_create(add_compensated, 0, &c.handle_->compensated_sum);
  MPI_Comm_rank(MPI_COMM_WORLD, &c.rank_);
  MPI_Comm_size(MPI_COMM_WORLD, &c.size_);
  return c;
}

Real Communicator::sum(Real value) const { return reduce(*handle_, value, MPI_DOUBLE, MPI_SUM); }
Real Communicator::min(Real value) const { return reduce(*handle_, value, MPI_DOUBLE, MPI_MIN); }
Real Communicator::max(Real value) const { return reduce(*handle_, value, MPI_DOUBLE, MPI_MAX); }
GlobalIndex Communicator::sum(GlobalIndex value) const {
  return reduce(*handle_, value, MPI_INT64_T, MPI_SUM);
}
GlobalIndex Communicator::max(GlobalIndex value) const {
  return reduce(*handle_, value, MPI_INT64_T, MPI_MAX);
}

void Communicator::sum(std::vector<Real>& values) const { reduce(*handle_, values, MPI_DOUBLE, MPI_SUM); }
void Communicator::min(std::vector<Real>& values) const { reduce(*handle_, values, MPI_DOUBLE, MPI_MIN); }
void Communicator::max(std::vector<Real>& values) const { reduce(*handle_, values, MPI_DOUBLE, MPI_MAX); }

void Communicator::max(std::vector<GlobalIndex>& values) const { reduce(*handle_, values, MPI_INT64_T, MPI_MAX); }

void Communicator::sum(std::vector<CompensatedSum>& values) const {
  reduce(*handle_, values, handle_->sum_pair, handle_->compensated_sum);
}

GlobalIndex Communicator::exclusive_sum(GlobalIndex value) const {
  GlobalIndex result = 0;
  ++handle_->collectives;
  MPI_Exscan(&value, &result, 1, MPI_INT64_T, MPI_SUM, handle_->comm);
  return rank_ == 0 ? 0 : result;
}

GlobalIndex Communicator::exclusive_max(GlobalIndex value) const {
  GlobalIndex result = -1;
  ++handle_->collectives;
  MPI_Exscan(&value, &result, 1, MPI_INT64_T, MPI_MAX, handle_->comm);
  return rank_ == 0 ? -1 : result;
}

void Communicator::broadcast(Bytes& bytes, int from) const {
  GlobalIndex size = static_cast<GlobalIndex>(bytes.size());
  ++handle_->collectives;
  MPI_Bcast(&size, 1, MPI_INT64_T, from, handle_->comm);
  bytes.resize(size);
  constexpr GlobalIndex chunk = 1 << 30;
  for (GlobalIndex start = 0; start < size; start += chunk)
    MPI_Bcast(bytes.data() + start, static_cast<int>(std::min(chunk, size - start)), MPI_BYTE, from, handle_->comm);
}

void Communicator::broadcast(std::string& text, int from) const {
  Bytes bytes(text.begin(), text.end());
  broadcast(bytes, from);
  text.assign(bytes.begin(), bytes.end());
}

std::vector<Communicator::Bytes> Communicator::gather(const Bytes& bytes) const {
  const int mine = static_cast<int>(bytes.size());
  std::vector<int> sizes(root() ? size_ : 0), starts(root() ? size_ : 0);
  ++handle_->collectives;
  MPI_Gather(&mine, 1, MPI_INT, sizes.data(), 1, MPI_INT, 0, handle_->comm);
  int total = 0;
  for (std::size_t r = 0; r < sizes.size(); ++r) {
    starts[r] = total;
    total += sizes[r];
  }
  Bytes all(total);
  MPI_Gatherv(bytes.data(), mine, MPI_BYTE, all.data(), sizes.data(), starts.data(), MPI_BYTE, 0, handle_->comm);
  std::vector<Bytes> parts;
  for (std::size_t r = 0; r < sizes.size(); ++r)
    parts.emplace_back(all.begin() + starts[r], all.begin() + starts[r] + sizes[r]);
  return parts;
}

std::vector<std::pair<int, Communicator::Bytes>> Communicator::exchange(
    const std::map<int, Bytes>& outgoing) const {
  std::vector<std::pair<int, Bytes>> incoming;
  const int tag = exchange_tag + (handle_->exchange_round++ & 1);
  ++handle_->collectives;
  std::vector<MPI_Request> sends;
  for (const auto& [target, bytes] : outgoing) {
    if (target == rank_) {
      incoming.emplace_back(rank_, bytes);
      continue;
    }
    sends.emplace_back();
    debug_check(bytes.size() < (1u << 31), "one message exceeds 2 GB");
    MPI_Issend(bytes.data(), static_cast<int>(bytes.size()), MPI_BYTE, target, tag, handle_->comm, &sends.back());
    ++handle_->messages;
    handle_->bytes += static_cast<GlobalIndex>(bytes.size());
  }
  MPI_Request barrier = MPI_REQUEST_NULL;
  for (int done = 0; !done;) {
    int waiting = 0;
    MPI_Message message;
    MPI_Status status;
    MPI_Improbe(MPI_ANY_SOURCE, tag, handle_->comm, &waiting, &message, &status);
    if (waiting) {
      int size = 0;
      MPI_Get_count(&status, MPI_BYTE, &size);
      Bytes bytes(size);
      MPI_Mrecv(bytes.data(), size, MPI_BYTE, &message, MPI_STATUS_IGNORE);
      incoming.emplace_back(status.MPI_SOURCE, std::move(bytes));
    }
    if (barrier != MPI_REQUEST_NULL) {
      MPI_Test(&barrier, &done, MPI_STATUS_IGNORE);
    } else {
      int sent = 1;
      MPI_Testall(static_cast<int>(sends.size()), sends.data(), &sent, MPI_STATUSES_IGNORE);
      if (sent) MPI_Ibarrier(handle_->comm, &barrier);
    }
  }
  std::sort(incoming.begin(), incoming.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  return incoming;
}

void Communicator::fail_together(const std::string& failure) const {
  const int speaker = static_cast<int>(min(static_cast<Real>(failure.empty() ? size_ : rank_)));
  if (speaker == size_) return;
  std::string text = failure;
  broadcast(text, speaker);
  throw NumericalFailure(text);
}

void Communicator::barrier() const {
  ++handle_->collectives;
  MPI_Barrier(handle_->comm);
}

void Communicator::abort(int code) const {
  MPI_Abort(handle_->comm, code);
  std::abort();
}

GlobalIndex Communicator::messages() const { return handle_->messages; }
GlobalIndex Communicator::bytes() const { return handle_->bytes; }
GlobalIndex Communicator::collectives() const { return handle_->collectives; }

}  // namespace mpm
