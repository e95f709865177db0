#include "serp/_util/arrays.hpp"

namespace serp {

void bind_adapted_model(nb::module_&) {}

}  // namespace serp
