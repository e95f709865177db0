// Refusing what compiled code could not work with.
#pragma once

#include <stdexcept>

namespace serp {

/// Throws std::invalid_argument, a ValueError in Python, where something does not fit.
inline void require(bool fits, const char* message) {
    if (!fits) throw std::invalid_argument(message);
}

}  // namespace serp
