#include "serp/_util/arrays.hpp"

namespace serp {

void bind_closed_graph(nb::module_&) {}

}  // namespace serp
