#include "mpm_hpc/io/together.hpp"

#include <string>

#include "mpm_hpc/base/error.hpp"

namespace mpm {

void agree_on_fault(const Communicator& communicator, const std::exception_ptr& fault) {
  const int speaker = static_cast<int>(
      communicator.min(static_cast<Real>(fault ? communicator.rank() : communicator.size())));
  if (speaker == communicator.size()) return;

  std::string message(1, '\0');  // the kind, then the text
  if (fault && communicator.rank() == speaker) {
    try {
      std::rethrow_exception(fault);
    } catch (const Error& error) {
      message = static_cast<char>(error.code()) + std::string(error.what());
    } catch (const std::exception& error) {
      message += error.what();
    } catch (...) {
      message += "unknown exception";
    }
  }
  communicator.broadcast(message, speaker);
  const std::string text = message.substr(1);
  switch (static_cast<ExitCode>(message[0])) {
    case ExitCode::user_error:
      throw UserError(text);
    case ExitCode::numerical_failure:
      throw NumericalFailure(text);
    case ExitCode::file_failure:
      throw FileError(text);
    default:
      throw LogicError(text);
  }
}

}  // namespace mpm
