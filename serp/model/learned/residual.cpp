#include "serp/_util/arrays.hpp"

namespace serp {

void bind_residual(nb::module_&) {}

}  // namespace serp
