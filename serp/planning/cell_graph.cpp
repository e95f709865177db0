#include "serp/_util/arrays.hpp"

namespace serp {

void bind_cell_graph(nb::module_&) {}

}  // namespace serp
