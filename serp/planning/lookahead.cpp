#include "serp/_util/arrays.hpp"

namespace serp {

void bind_lookahead(nb::module_&) {}

}  // namespace serp
