// The compiled part of serp. Each room binds its own classes, next to their code.
#include <nanobind/nanobind.h>

namespace serp {

using Module = nanobind::module_;
void bind_model(Module&);
void bind_adapted_model(Module&);
void bind_residual(Module&);
void bind_outcome_counts(Module&);
void bind_lookahead(Module&);
void bind_closed_graph(Module&);
void bind_cell_graph(Module&);
void bind_goal_search(Module&);
void bind_network(Module&);
void bind_gradient_updates(Module&);

}  // namespace serp

NB_MODULE(_core, module) {
    nanobind::set_leak_warnings(false);
    module.doc() = "The compiled part of serp: steps of a model, planning on it, and learning.";
    serp::bind_model(module);
    serp::bind_adapted_model(module);
    serp::bind_residual(module);
    serp::bind_outcome_counts(module);
    serp::bind_cell_graph(module);
    serp::bind_lookahead(module);
    serp::bind_closed_graph(module);
    serp::bind_goal_search(module);
    serp::bind_network(module);
    serp::bind_gradient_updates(module);
}
