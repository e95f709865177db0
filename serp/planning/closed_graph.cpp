#include "serp/planning/closed_graph.hpp"

#include <nanobind/stl/optional.h>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace serp {

namespace {

/// Most bytes of the columns of a graph; up to twice as many are reserved.
constexpr std::size_t GRAPH_BYTES = 200'000'000;
/// Expansion ends if, after so many edges, this fraction of them leads to new states.
constexpr int JUDGED_FROM = 512;
constexpr double NEVER_MET = 0.98;

[[noreturn]] void refuse(const std::string& why) { throw std::invalid_argument(why); }

/// Calls `visit` with every column that is saved: its name, its numbers, how many there have to be,
/// and the least and the largest that is possible; infinities where any number is.
template <class Of, class Visit>
void for_each_column(Of& of, int actions, Visit visit) {
    constexpr double ANY = std::numeric_limits<double>::infinity(), MOST = std::int64_t{1} << 53;
    const std::size_t nodes = of.layer.size(), edges = of.action.size();
    visit("states", of.states, nodes * of.width, -ANY, ANY);
    visit("layer", of.layer, nodes, 0.0, 1 << 30);
    visit("undefined", of.undefined, nodes, 0.0, 1.0);
    visit("value", of.value, nodes, -ANY, ANY);
    visit("risk", of.risk, nodes, 0.0, 1.0);
    visit("steps", of.steps, nodes, -1.0, SAFE);
    visit("inside", of.inside, nodes, 0.0, 1.0);
    visit("slack", of.slack, nodes, 0.0, 1.0);
    visit("risk_kind", of.risk_kind, 1, CERTAIN, UNTIL_END);
    visit("first_edge", of.first_edge, of.first_edge.size(), 0.0, edges);
    visit("action", of.action, edges, 0.0, actions - 1);
    visit("flags", of.flags, edges, 0.0, MOST);
    visit("reward", of.reward, edges, -ANY, ANY);
    visit("step_risk", of.step_risk, edges, 0.0, 1.0);
    visit("going_on", of.going_on, edges, 0.0, 1.0);
    visit("first_outcome", of.first_outcome, edges + 1, 0.0, of.target.size());
    visit("target", of.target, of.target.size(), ENDED, of.nodes() - 1);
    visit("chance", of.chance, of.target.size(), 0.0, 1.0);
}

void check_rises(const std::vector<std::int32_t>& first, int end, const char* name) {
    if (first.empty() || first.front() != 0 || first.back() != end ||
        !std::is_sorted(first.begin(), first.end()))
        refuse(std::string(name) + " does not rise from 0 to " + std::to_string(end));
}

/// Throws where a column of a graph does not fit the others.
void check(const Graph& of, int actions) {
    if (of.bytes() > 2 * GRAPH_BYTES) refuse("it is too large");
    for_each_column(of, actions, [](const std::string& name, const auto& column,
                                    std::size_t length, double low, double high) {
        if (column.size() != length)
            refuse(name + " has " + std::to_string(column.size()) + " entries, not " +
                   std::to_string(length));
        for (const auto entry : column)
            if (std::isfinite(high) && !(low <= entry && entry <= high))
                refuse(name + " has an entry that is not from " + std::to_string(low) + " to " +
                       std::to_string(high));
    });
    check_rises(of.first_edge, of.edges(), "first_edge");
    check_rises(of.first_outcome, of.outcomes(), "first_outcome");
    if (std::adjacent_find(of.first_outcome.begin(), of.first_outcome.end()) !=
        of.first_outcome.end())
        refuse("an edge has no outcome");
    if (of.expanded() > of.nodes() ||
        std::any_of(of.inside.begin() + of.expanded(), of.inside.end(), [](int in) { return in; }))
        refuse(std::to_string(of.expanded()) + " of " + std::to_string(of.nodes()) +
               " nodes are expanded, and more are inside");
}

double largest_of(const std::vector<double>& numbers) {
    double largest = 0.0;
    for (const double number : numbers) largest = std::max(largest, std::abs(number));
    return largest;
}

}  // namespace

ClosedGraph::ClosedGraph(const Model& model, Preferences preferences)
    : model_(model), stepper_(model.stepper()), preferences_(preferences), source_(model.fluents()),
      rows_(OUTCOMES * (model.fluents() + std::size_t{3})) {
    clear({});
}

void ClosedGraph::clear(std::vector<std::int64_t> inert) {
    for (const std::int64_t column : inert)
        if (column < 0 || column >= model_.fluents()) refuse("inert has no such fluent");
    graph_ = Graph{};
    graph_.width = model_.fluents();
    index_.clear();
    inert_ = std::move(inert);
    unit_ = 0.0, depth_ = 0;
}

void ClosedGraph::restore(Graph&& graph) {
    graph.width = model_.fluents();
    check(graph, model_.actions());
    graph_ = std::move(graph);
    graph_.best.assign(graph_.nodes(), -1);
    index_.index(graph_);
    mark_dead_ends(graph_);
    measure();
}

void ClosedGraph::grow(const double* states, int count, std::int64_t limit) {
    const int least = graph_.nodes() ? 0 : count;
    try {
        for (int k = 0; k < count && graph_.bytes() < GRAPH_BYTES; ++k) {
            std::copy_n(states + static_cast<std::size_t>(k) * graph_.width, graph_.width,
                        rows_.data());
            for (const std::int64_t column : inert_) rows_[column] = 0.0;
            index_.find_or_add(graph_, rows_.data(), 0);
        }
        std::int64_t judged = JUDGED_FROM;
        while (judged <= graph_.edges()) judged *= 2;
        while (!complete() && (graph_.expanded() < least || work() < limit) &&
               graph_.bytes() < GRAPH_BYTES) {
            expand_node();
            if (graph_.edges() < judged) continue;
            if (graph_.expanded() >= least && spreads()) break;
            while (judged <= graph_.edges()) judged *= 2;
        }
        solve();
    } catch (const std::bad_alloc&) {  // no room: no graph, the lookahead decides
        clear(inert_);
    } catch (...) {
        clear(inert_);
        throw;
    }
}

void ClosedGraph::expand_node() {
    const int node = graph_.expanded(), width = graph_.width, layer = graph_.layer[node] + 1;
    std::copy_n(graph_.state(node), width, source_.data());
    stepper_->from(source_.data());
    const bool branches = model_.branches();
    for (int action = 0; action < model_.actions(); ++action) {
        double* row = rows_.data();
        const Flags flags = stepper_->step(action, row);
        if (!(flags & APPLICABLE)) {
            if (flags & UNDEFINED) graph_.undefined[node] = 1;
            continue;
        }
        graph_.add_edge(action, flags, step_risk(flags, 0.0));
        if (!branches) {
            add_outcome(row, flags, 1.0, layer);
            continue;
        }
        const int count = stepper_->outcomes(action, row);
        for (int k = 0; k < count; ++k, row += width + 3)
            add_outcome(row, static_cast<Flags>(row[width + 1]), row[width + 2], layer);
    }
    graph_.end_node();
}

/// Adds an outcome, the state and reward `row`, to the newest edge. The learned chance of an end, which
/// the outcomes share, takes from the value of what follows. It does not take from its risk: nothing
/// learned hides what the file flags.
void ClosedGraph::add_outcome(double* row, Flags flags, double chance, int layer) {
    graph_.reward.back() += chance * row[graph_.width];
    std::int32_t target = ENDED;
    if (!(flags & TERMINAL)) {
        graph_.going_on.back() = going_on(flags);
        for (const std::int64_t column : inert_) row[column] = 0.0;
        target = index_.find_or_add(graph_, row, layer);
    }
    graph_.add_outcome(target, chance);
}

void ClosedGraph::solve() {
    serp::solve(graph_, preferences_);
    measure();
}

/// Finds what follows from the solved graph.
void ClosedGraph::measure() {
    unit_ = ALIKE * largest_of(graph_.value);
    depth_ = graph_.layer.empty() ? 0 : *std::max_element(graph_.layer.begin(), graph_.layer.end());
}

int ClosedGraph::find(const double* state) const {
    if (inert_.empty()) return index_.find(graph_, state);
    std::vector<double> row(state, state + graph_.width);
    for (const std::int64_t column : inert_) row[column] = 0.0;
    return index_.find(graph_, row.data());
}

std::optional<FirstActions> ClosedGraph::forecast(const double* state) {
    const int node = find(state);
    if (node < 0 || !graph_.inside[node]) return std::nullopt;
    FirstActions first = look_up(graph_, node, model_.actions(), preferences_, unit_);
    if (graph_.undefined[node]) {
        stepper_->from(state);
        for (int action = 0; action < model_.actions(); ++action)
            if (first.flags[action] == 0) first.flags[action] = stepper_->step(action, rows_.data());
    }
    return first;
}

bool ClosedGraph::ends(const double* state) const {
    const int node = find(state);
    return node >= 0 && graph_.inside[node] && serp::ends(graph_, node);
}

std::int64_t ClosedGraph::work() const {
    const std::int64_t edges = graph_.edges();
    const std::int64_t tried = std::int64_t{graph_.expanded()} * model_.actions();
    return std::max(edges, (8 * tried + edges * (64 + 3 * graph_.width)) / WORK);
}

bool ClosedGraph::spreads() const {
    const std::int64_t edges = graph_.edges(), expanded = graph_.expanded();
    return edges >= JUDGED_FROM && expanded * expanded >= edges &&
           graph_.nodes() > NEVER_MET * static_cast<double>(edges);
}

// For Python ---------------------------------------------------------------------------------------

namespace {

using State = In<double, nb::ndim<1>>;

nb::dict graph_columns(const ClosedGraph& closed) {
    const Graph& of = closed.graph();
    nb::dict columns;
    const auto add = [&columns](const char* name, auto numbers, auto...) {
        const std::size_t length = numbers.size();
        columns[name] = array_of(std::move(numbers), {length});
    };
    for_each_column(of, 0, add);
    add("inert", closed.inert());
    return columns;
}

void restore(ClosedGraph& closed, const nb::dict& columns) {
    Graph of;
    const auto take = [&columns](const char* name, auto& numbers, auto...) {
        using Number = typename std::decay_t<decltype(numbers)>::value_type;
        numbers = vector_of(nb::cast<In<Number, nb::ndim<1>>>(columns[name]));
    };
    for_each_column(of, 0, take);
    std::vector<std::int64_t> inert;
    take("inert", inert);
    closed.clear(std::move(inert));
    closed.restore(std::move(of));
}

void grow(ClosedGraph& closed, const In<double, nb::ndim<2>>& states, std::int64_t limit) {
    if (states.shape(1) != static_cast<std::size_t>(closed.graph().width))
        refuse("a state must have " + std::to_string(closed.graph().width) + " numbers");
    closed.grow(states.data(), static_cast<int>(states.shape(0)), limit);
}

std::optional<ForecastTuple> forecast(ClosedGraph& closed, const State& state) {
    auto first = closed.forecast(state_of(state, closed.graph().width));
    if (!first) return std::nullopt;
    return forecast_tuple(std::move(*first), closed.depth(),
                          closed.complete() ? Bound::EXHAUSTED : Bound::NODES);
}

}  // namespace

void bind_closed_graph(nb::module_& module) {
    nb::class_<ClosedGraph>(
        module, "ClosedGraph", "All states that can be reached, and the best action in each.")
        .def("__init__", [](ClosedGraph* self, const Model& model, double discount,
                            double accepted_risk) {
                new (self) ClosedGraph(model, {discount, accepted_risk});
            }, nb::arg("model"), nb::arg("discount"), nb::arg("accepted_risk"), nb::keep_alive<1, 2>())
        .def("begin", [](ClosedGraph& self, const In<std::int64_t, nb::ndim<1>>& inert) {
                self.clear(vector_of(inert));
            }, nb::arg("inert"), "Forget all nodes; `inert` are fluents that make no difference.")
        .def("grow", &grow, nb::arg("states"), nb::arg("limit"),
             "Add states [n, F] and what can be reached from them, and solve the graph.")
        .def("solve", &ClosedGraph::solve,
             "Find the best policy of every node.")
        .def("look_up", &forecast, nb::arg("state"),
             "Return the fields of a `Forecast` for a state [F]; None where the state is not in the "
             "graph, or its best policy leaves the graph.")
        .def("ends", [](const ClosedGraph& self, const State& state) {
                return self.ends(state_of(state, self.graph().width));
            }, nb::arg("state"),
            "Return whether the best policy leads from a state [F] to the end of the task. The first "
            "outcome of every step is followed.")
        .def_prop_ro("nodes", [](const ClosedGraph& self) { return self.graph().nodes(); })
        .def_prop_ro("edges", [](const ClosedGraph& self) { return self.graph().edges(); })
        .def_prop_ro("work", &ClosedGraph::work,
                     "Edges that take as long to follow as the graph took to grow.")
        .def_prop_ro("complete", &ClosedGraph::complete,
                     "Whether everything that can be reached is in the graph.")
        .def_prop_ro("spreads", &ClosedGraph::spreads,
                     "Whether edges hardly ever lead to a known state, so that the graph will not "
                     "close.")
        .def_prop_ro("largest", [](const ClosedGraph& self) {
                return largest_of(self.graph().states);
            }, "Largest magnitude of a number in all states.")
        .def("columns", &graph_columns,
             nb::sig("def columns(self) -> dict[str, numpy.typing.NDArray[typing.Any]]"),
             "Return copies of all columns.")
        .def("restore", &restore, nb::arg("columns"),
             nb::sig("def restore(self, columns: dict[str, numpy.typing.NDArray[typing.Any]]) "
                     "-> None"),
             "Take a graph with these columns, or raise a ValueError where they do not fit "
             "together. What follows from the others is not read.");
}

}  // namespace serp
