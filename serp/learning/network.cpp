#include "serp/_util/arrays.hpp"

namespace serp {

void bind_learning(nb::module_&) {}

}  // namespace serp
