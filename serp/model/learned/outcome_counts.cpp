#include "serp/_util/arrays.hpp"

namespace serp {

void bind_outcome_counts(nb::module_&) {}

}  // namespace serp
