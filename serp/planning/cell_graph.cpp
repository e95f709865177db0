// A planning graph over cells of the state space; cell_graph.py says what it is for.
#include <nanobind/stl/pair.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "serp/_util/arrays.hpp"
#include "serp/model/model.hpp"
#include "serp/planning/cells.hpp"
#include "serp/planning/graph.hpp"

namespace serp {

namespace {

/// Most control periods for which an edge holds its action; it ends where it leads a cell's width
/// away.
constexpr int HOLD = 16;
/// Weights in an interpolation that are a smaller fraction of the others are left out.
constexpr double SMALL = 0.01;
/// Most cells that an edge leads to.
constexpr int MOST_AROUND = 16;
/// Most sweeps over all edges, and sweeps over the best edges after each of them. Further ones
/// continue from these values at the next build.
constexpr int SWEEPS = 30, EVALUATIONS = 4;
/// Sweeps end where no value changes by more than this fraction of the largest.
constexpr double PRECISION = 1e-4;

/// An edge, which holds its action for one or several control periods.
struct HeldEdge {
    std::int32_t action;
    Flags flags = 0;
    double step_risk = 0.0;
    double reward = 0.0;        ///< discounted sum of rewards
    double periods = 0.0;       ///< discounted number of control periods
    double weight = 1.0;        ///< discount, but that of one period, of what follows
    double beyond = 0.0;        ///< discount of what follows if it is not known; else 0
    std::int32_t node = ENDED;  ///< node of the cell that it leads to
};

/// The edges to choose among, in flat arrays: loops run over them a hundred times.
struct Choices {
    std::vector<std::int32_t> node;           ///< [n] cells where there is a choice
    std::vector<std::int32_t> first_edge{0};  ///< [n + 1]
    std::vector<double> reward;
    std::vector<std::int32_t> first_outcome{0};
    std::vector<std::int32_t> target;
    std::vector<double> chance;
};

struct Change {
    double change = 0.0, largest = 0.0;
};

class CellGraph {
public:
    CellGraph(double discount, double accepted_risk, int max_edges)
        : discount_(discount), accepted_risk_(accepted_risk), max_edges_(max_edges) {}

    int nodes() const { return index_.size(); }
    int edges() const { return static_cast<int>(edges_.size()); }
    /// Returns the values of the cells, and of what is not known.
    CellValues values(double unknown) const;

    /// Expands the graph anew from states [N * F], until all nodes are expanded, there is no room,
    /// or `limit` steps were predicted. An action whose step is at least as uncertain as `unknown`
    /// leads beyond. Returns these steps, and whether all are expanded.
    std::pair<std::int64_t, bool> expand(const Model& model, Cells cells,
                                         const std::vector<double>& roots, std::int64_t limit,
                                         double unknown);

    /// Begins with former values of cells; with `otherwise` where there are none.
    void begin(const CellValues* former, double otherwise);

    /// Finds the values of the cells; returns that of the first one.
    ///
    /// At every cell actions of the best rank are chosen among, see preference.py. The probabilities
    /// of what an edge leads to come from the division into cells as much as from the world. So risk
    /// is not minimised before all else, as in an exact graph, where it could only be avoided by
    /// never coming near anything. What is unsafe is worth `worst`, the least value; what is not
    /// known is worth `beyond`.
    double solve(double worst, double beyond);

    /// Returns rewards per control period, and actions, of the edges after which the task goes on:
    /// the reward of an end, or of what is unsafe, does not last.
    std::pair<std::vector<double>, std::vector<std::int32_t>> lasting_rates() const;

private:
    const double* state(int node) const {
        return states_.data() + static_cast<std::size_t>(node) * cells_.width();
    }
    int expanded() const { return static_cast<int>(first_edge_.size()) - 1; }
    void clear() {
        index_.clear(), states_.clear(), undefined_.clear(), value_.clear();
        first_edge_.assign(1, 0), edges_.clear(), reached_.clear();
    }
    int node_of(const double* row);
    std::int64_t expand_node(Stepper& first, Stepper& further, int actions, double unknown);
    void interpolate();
    Choices choices(double worst, double beyond);
    Change sweep(const Choices& choices, std::vector<std::int32_t>& best, bool backwards,
                 bool evaluates);

    double discount_, accepted_risk_;
    int max_edges_;
    Cells cells_{{}, {}, {}};
    DigestIndex index_;                       ///< nodes by their cells
    std::vector<double> states_;              ///< [N * F]
    std::vector<std::uint8_t> undefined_;     ///< [N] whether the result of an action is undefined
    std::vector<double> value_;               ///< [N]
    std::vector<std::int32_t> first_edge_{0};  ///< [expanded + 1]
    std::vector<HeldEdge> edges_;             ///< [E]
    std::vector<double> reached_;             ///< [E * F] states that edges lead to
    std::vector<std::int32_t> first_outcome_;  ///< [E + 1]
    std::vector<std::int32_t> target_;        ///< [O] cells that an edge leads to
    std::vector<double> chance_;              ///< [O] their discounted weights
};

int CellGraph::node_of(const double* row) {
    const int next = nodes(), node = index_.find_or_add(cells_.cell_of(row));
    if (node == next) {
        states_.insert(states_.end(), row, row + cells_.width());
        undefined_.push_back(0);
    }
    return node;
}

std::pair<std::int64_t, bool> CellGraph::expand(const Model& model, Cells cells,
                                                const std::vector<double>& roots,
                                                std::int64_t limit, double unknown) {
    cells_ = std::move(cells);
    clear();
    const int actions = model.actions();
    const int most_nodes = max_edges_ / std::max(1, actions) + actions;
    std::int64_t steps = 0;
    try {
        for (std::size_t at = 0; at < roots.size() && nodes() < most_nodes; at += cells_.width())
            node_of(roots.data() + at);
        const auto first = model.stepper(), further = model.stepper();
        while (expanded() < nodes()) {
            if (nodes() + actions > most_nodes || edges() > max_edges_ || steps >= limit)
                return {steps, false};
            steps += expand_node(*first, *further, actions, unknown);
        }
        return {steps, true};
    } catch (const std::bad_alloc&) {  // no room
        clear();
        return {steps, false};
    }
}

/// Expands the next node; returns the steps that were predicted.
std::int64_t CellGraph::expand_node(Stepper& first, Stepper& further, int actions, double unknown) {
    const int node = expanded(), width = cells_.width();
    const std::vector<double> source(state(node), state(node) + width);
    std::vector<double> now(width + 1), out(width + 1);
    std::int64_t steps = 0;
    first.from(source.data());
    for (int action = 0; action < actions; ++action) {
        HeldEdge edge{action};
        const bool known = first.uncertainty(action) < unknown;
        bool ended = false, far = false;
        int held = 0;
        while (held < HOLD && !ended && !far) {
            if (held) further.from(now.data());
            Flags flags = (held ? further : first).step(action, out.data());
            ++steps;
            if (!(flags & APPLICABLE)) {
                if (held == 0 && (flags & UNDEFINED)) undefined_[node] = 1;
                break;
            }
            const double risk = step_risk(flags, accepted_risk_);
            flags = marked(flags, risk);
            edge.flags = held ? joined(edge.flags, flags) : flags;
            edge.step_risk += (1.0 - edge.step_risk) * risk;
            edge.reward += edge.weight * out[width];
            edge.periods += edge.weight;
            edge.weight *= discount_ * going_on(flags);
            ++held;
            now.swap(out);
            ended = flags & TERMINAL;
            far = !known;
            for (int i = 0; i < width && !far; ++i) {
                const double moved = std::abs(now[i] - source[i]);
                far = moved * cells_.scale[i] >= 1.0 || (moved > 0.0 && cells_.scale[i] == 0.0);
            }
        }
        if (held == 0) continue;
        if (!ended) {
            if (known && cells_.in_range(now.data()))
                edge.node = node_of(now.data());
            else
                edge.beyond = edge.weight;
        }
        edge.weight /= discount_;
        edges_.push_back(edge);
        reached_.insert(reached_.end(), now.begin(), now.begin() + width);
    }
    first_edge_.push_back(edges());
    return steps;
}

/// Lets every edge lead to the cells around the state that it reaches, weighted by nearness.
///
/// A plan would otherwise gain up to a cell's width with every edge. Weights that are positive and
/// sum to 1 keep value iteration a contraction (Gordon, ICML 1995). Small ones are left out.
void CellGraph::interpolate() {
    first_outcome_.assign(1, 0), target_.clear(), chance_.clear();
    const int width = cells_.width();
    CellsBeside beside(cells_);
    for (int k = 0; k < edges(); ++k) {
        const HeldEdge& edge = edges_[k];
        const double* row = reached_.data() + static_cast<std::size_t>(k) * width;
        const std::size_t begin = target_.size();
        double total = 0.0;
        auto add = [&](int node, double near) {
            target_.push_back(node), chance_.push_back(near);
            total += near;
        };
        if (edge.node >= 0) {
            add(edge.node, cells_.nearness(row, state(edge.node)));
            beside.from(row);
        }
        for (int i = 0; i < width && edge.node >= 0; ++i) {
            if (!(cells_.scale[i] > 0.0)) continue;
            for (const int by : {1, -1}) {
                if (target_.size() - begin == MOST_AROUND) break;
                const int node = index_.find(beside.digest_of(i, by));
                if (node < 0) continue;
                const double near = cells_.nearness(row, state(node));
                if (near > SMALL * total) add(node, near);
            }
        }
        for (std::size_t o = begin; o < chance_.size(); ++o) chance_[o] *= edge.weight / total;
        first_outcome_.push_back(static_cast<std::int32_t>(target_.size()));
    }
}

void CellGraph::begin(const CellValues* former, double otherwise) {
    if (former && former->cells().width() != cells_.width())
        throw std::invalid_argument("the former cells have other fluents");
    interpolate();
    value_.assign(nodes(), otherwise);
    for (int node = 0; former && node < nodes(); ++node) value_[node] = former->at(state(node));
}

Choices CellGraph::choices(double worst, double beyond) {
    Choices found;
    for (int node = 0; node < expanded(); ++node) {
        const int start = first_edge_[node], end = first_edge_[node + 1];
        if (start == end) {
            value_[node] = undefined_[node] ? worst : 0.0;
            continue;
        }
        int lowest = 2;
        for (int k = start; k < end; ++k) lowest = std::min(lowest, rank_of(edges_[k].flags));
        for (int k = start; k < end; ++k) {
            const HeldEdge& edge = edges_[k];
            if (rank_of(edge.flags) > lowest) continue;
            const double risk = edge.step_risk, weight = discount_ * edge.weight;
            found.reward.push_back(
                edge.reward + ((1.0 - risk) * beyond * edge.beyond + risk * worst * weight));
            for (int o = first_outcome_[k]; o < first_outcome_[k + 1]; ++o) {
                found.target.push_back(target_[o]);
                found.chance.push_back((1.0 - risk) * discount_ * chance_[o]);
            }
            found.first_outcome.push_back(static_cast<std::int32_t>(found.target.size()));
        }
        found.node.push_back(node);
        found.first_edge.push_back(static_cast<std::int32_t>(found.reward.size()));
    }
    return found;
}

/// Finds the values of all cells once, in one of two orders; `best` [n] are their best edges.
/// Where it only evaluates, just these are followed.
Change CellGraph::sweep(const Choices& choices, std::vector<std::int32_t>& best, bool backwards,
                        bool evaluates) {
    Change found;
    const int count = static_cast<int>(choices.node.size());
    for (int k = 0; k < count; ++k) {
        const int at = backwards ? count - 1 - k : k;
        double most = -std::numeric_limits<double>::infinity();
        const int start = evaluates ? best[at] : choices.first_edge[at];
        const int end = evaluates ? start + 1 : choices.first_edge[at + 1];
        int chosen = start;
        for (int edge = start; edge < end; ++edge) {
            double total = choices.reward[edge];
            for (int o = choices.first_outcome[edge]; o < choices.first_outcome[edge + 1]; ++o)
                total += choices.chance[o] * value_[choices.target[o]];
            if (total > most) most = total, chosen = edge;
        }
        double& value = value_[choices.node[at]];
        found.change = std::max(found.change, std::abs(most - value));
        found.largest = std::max(found.largest, std::abs(most));
        value = most, best[at] = chosen;
    }
    return found;
}

double CellGraph::solve(double worst, double beyond) {
    if (value_.size() != static_cast<std::size_t>(nodes()) || value_.empty())
        throw std::invalid_argument("there are no values to begin with");
    const Choices found = choices(worst, beyond);
    std::vector<std::int32_t> best(found.node.size());
    for (int round = 0; round < SWEEPS; ++round) {
        const auto [change, largest] = sweep(found, best, round % 2 == 0, false);
        if (change <= PRECISION * largest) break;
        for (int again = 0; again < EVALUATIONS; ++again) sweep(found, best, again % 2 == 0, true);
    }
    return value_[0];
}

std::pair<std::vector<double>, std::vector<std::int32_t>> CellGraph::lasting_rates() const {
    std::pair<std::vector<double>, std::vector<std::int32_t>> found;
    for (const HeldEdge& edge : edges_) {
        if (edge.step_risk != 0.0 || (edge.node == ENDED && !(edge.beyond > 0.0))) continue;
        found.first.push_back(edge.reward / edge.periods);
        found.second.push_back(edge.action);
    }
    return found;
}

CellValues CellGraph::values(double unknown) const {
    std::vector<double> value = value_;
    value.push_back(unknown);
    return CellValues(cells_, states_, std::move(value));
}

}  // namespace

// For Python ---------------------------------------------------------------------------------------

namespace {

using Numbers = In<double, nb::ndim<1>>;

std::pair<std::int64_t, bool> expand(CellGraph& graph, const Model& model, const Numbers& low,
                                     const Numbers& scale, const Numbers& area,
                                     const In<double, nb::ndim<2>>& roots, std::int64_t limit,
                                     double unknown) {
    Cells cells{vector_of(low), vector_of(scale), vector_of(area)};
    const auto width = static_cast<std::size_t>(model.fluents());
    if (low.size() != width || roots.shape(1) != width || width == 0)
        throw std::invalid_argument("cells and states need " + std::to_string(width) + " numbers");
    const std::vector<double> states = vector_of(roots);
    return graph.expand(model, std::move(cells), states, limit, unknown);
}

}  // namespace

void bind_cells(nb::module_& module);

void bind_cell_graph(nb::module_& module) {
    bind_cells(module);
    nb::class_<CellGraph>(module, "CellGraph", "A planning graph over cells of the state space.")
        .def(nb::init<double, double, int>(), nb::arg("discount"), nb::arg("accepted_risk"),
             nb::arg("max_edges"))
        .def_prop_ro("edges", &CellGraph::edges)
        .def("expand", &expand, nb::arg("model"), nb::arg("low"), nb::arg("scale"),
             nb::arg("area"), nb::arg("roots"), nb::arg("limit"), nb::arg("unknown"))
        .def("lasting_rates", [](const CellGraph& graph) {
                auto [rates, actions] = graph.lasting_rates();
                const std::size_t count = rates.size();
                return std::make_pair(array_of(std::move(rates), {count}),
                                      array_of(std::move(actions), {count}));
            })
        .def("begin", &CellGraph::begin, nb::arg("former").none(), nb::arg("otherwise"))
        .def("solve", &CellGraph::solve, nb::arg("worst"), nb::arg("beyond"))
        .def("values", &CellGraph::values, nb::arg("unknown"));
}

}  // namespace serp
