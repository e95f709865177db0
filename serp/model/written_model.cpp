#include "serp/_util/arrays.hpp"

namespace serp {

void bind_model(nb::module_&) {}

}  // namespace serp
