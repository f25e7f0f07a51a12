// The flag between a signal handler and the step loop.
#pragma once

namespace mpm {

bool stop_was_requested();

}  // namespace mpm
