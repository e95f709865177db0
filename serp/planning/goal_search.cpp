#include "serp/_util/arrays.hpp"

namespace serp {

void bind_goal_search(nb::module_&) {}

}  // namespace serp
