#include "serp/planning/value_iteration.hpp"

#include <cmath>

namespace serp {

namespace {

constexpr double INF = std::numeric_limits<double>::infinity();
constexpr double TINY = 1e-9;
/// Precision of the values of states: value iteration ends where none changed by more than this
/// fraction of the largest.
constexpr double EXACT = 1e-9;
/// Most sweeps of value iteration, and of each of its parts; fewer where these would follow more than
/// so many outcomes, which takes about a second.
constexpr int MOST_SWEEPS = 3'000, OUTCOMES_FOLLOWED = 60'000'000;
/// Most sweeps over the best edges after a sweep over all edges.
constexpr int POLICY_SWEEPS = 10;
/// Most policies whose risks are bounded node by node; then none may risk more than the least.
constexpr int BOUNDED = 8;
/// In place of the node of an edge that is taken once: no outcome leads there.
constexpr int ONCE = -2;

/// What follows an edge: the expectation of a column over its outcomes, and the probability that it
/// leads back to its node.
struct Following {
    double expected = 0.0, own = 0.0;
};

inline Following following(const Graph& graph, const std::vector<double>& column, int edge,
                           int node) {
    Following of;
    for (int k = graph.first_outcome[edge]; k < graph.first_outcome[edge + 1]; ++k) {
        const int target = graph.target[k];
        if (target == node)
            of.own += graph.chance[k];
        else if (target >= 0)
            of.expected += graph.chance[k] * column[target];
    }
    return of;
}

/// Returns the risk of an edge that is taken again while it leads back to its node. The least risk is
/// a fixed point of it, whether or not the edge is taken again (ONCE).
double lasting_risk(const Graph& graph, const std::vector<double>& risk, int edge, int node,
                    double discount) {
    const bool until_end = graph.risk_kind[0] == UNTIL_END;
    const double danger = graph.step_risk[edge];
    const Following after = following(graph, risk, edge, node);
    const double rest = (1.0 - danger) * (until_end ? 1.0 : discount);
    if (until_end && 1.0 - rest * after.own < TINY) return 1.0;  // it never ends
    const double lasting = (danger + rest * after.expected) / std::max(1.0 - rest * after.own, TINY);
    return std::min(lasting, 1.0);  // rounding may make it larger
}

/// Returns the value of an edge that is taken again while it leads back to its node.
///
/// It is the value to choose by. Taken once (ONCE), to wait for nothing at discount 1 would be worth
/// what can be done afterwards, and might be done for ever.
double lasting_value(const Graph& graph, int edge, int node, double discount) {
    const Following after = following(graph, graph.value, edge, node);
    const double rest = discount * graph.going_on[edge];
    const double total = graph.reward[edge] + rest * after.expected;
    if (after.own == 0.0) return total;
    if (rest * after.own < 1.0 - TINY) return total / (1.0 - rest * after.own);
    return total != 0.0 ? total + graph.value[node] : 0.0;
}

/// Returns the control periods before the first risk on an edge and what follows it.
std::int64_t steps_through(const Graph& graph, int edge) {
    if (graph.step_risk[edge] > 0.0) return 0;
    std::int64_t least = SAFE;
    for (int k = graph.first_outcome[edge]; k < graph.first_outcome[edge + 1]; ++k)
        if (graph.target[k] >= 0) least = std::min(least, graph.steps[graph.target[k]]);
    return least == SAFE ? least : least + 1;
}

/// Returns whether damage is certain after an edge.
bool is_certain(const Graph& graph, int edge) {
    if (graph.step_risk[edge] >= 1.0) return true;
    for (int k = graph.first_outcome[edge]; k < graph.first_outcome[edge + 1]; ++k)
        if (graph.target[k] < 0 || !graph.dead_end[graph.target[k]]) return false;
    return true;
}

/// Returns whether the risk of an edge of the best rank counts as the least.
bool is_accepted(const Graph& graph, int edge, int node, Preferences preferences) {
    const double risk = lasting_risk(graph, graph.risk, edge, node, preferences.discount);
    return graph.slack[node] &&
           within_slack(risk, graph.risk[node] + ALIKE, preferences.accepted) &&
           !graph.dead_end[node] && !is_certain(graph, edge);
}

/// Returns whether an edge that is taken once, with the safest policy from then on, risks more than is
/// accepted beyond the least; whether it is certain damage where all leads to that.
bool is_too_risky(const Graph& graph, int edge, int node, Preferences preferences) {
    if (graph.risk[node] >= 1.0 - ALIKE) return graph.step_risk[edge] >= 1.0;
    return lasting_risk(graph, graph.risk, edge, ONCE, preferences.discount) >
           graph.risk[node] + preferences.accepted + 2.0 * ALIKE;
}

/// Calls a function with all expanded nodes, in one of two orders.
template <class Function>
void for_each_node(const Graph& graph, bool backwards, Function function) {
    const int expanded = graph.expanded();
    for (int k = 0; k < expanded; ++k) function(backwards ? expanded - 1 - k : k);
}

/// Value iteration of one graph.
class Solution {
public:
    Solution(Graph& graph, Preferences preferences)
        : graph_(graph), preferences_(preferences), allowed_(graph.edges()) {}

    void find() {
        begin();
        const bool by_chance = is_by_chance();
        if (by_chance) {
            find_values();
            graph_.risk_kind[0] = ends(graph_, 0) ? UNTIL_END : DISCOUNTED;
        }
        if (is_risky()) find_risks();
        std::fill(graph_.dead_end.begin(), graph_.dead_end.end(), 0);
        if (by_chance && preferences_.accepted > 0.0) {
            mark_dead_ends(graph_);
            find_accepted_values();
        } else {
            find_values();
        }
        mark_inside();
    }

private:
    void begin() {
        const size_t nodes = graph_.nodes(), expanded = graph_.expanded();
        graph_.value.resize(nodes);
        std::fill(graph_.value.begin() + expanded, graph_.value.end(), 0.0);
        graph_.risk.assign(nodes, 0.0);
        graph_.steps.assign(nodes, SAFE);
        graph_.best.assign(nodes, -1);
        graph_.inside.assign(nodes, 0);
        std::fill_n(graph_.inside.begin(), expanded, 1);
        graph_.dead_end.resize(nodes);
        graph_.slack.assign(nodes, 1);
        graph_.risk_kind.assign(1, CERTAIN);
        for_each_node(graph_, false, [this](int node) {
            const int lowest = graph_.best_rank(node);
            for (int edge = graph_.first_edge[node]; edge < graph_.first_edge[node + 1]; ++edge)
                allowed_[edge] = rank_of(graph_.flags[edge]) == lowest;
            if (is_leaf(node)) {
                graph_.value[node] = 0.0;
                if (graph_.undefined[node]) graph_.risk[node] = 1.0, graph_.steps[node] = 0;
            }
        });
    }

    bool is_leaf(int node) const { return graph_.first_edge[node] == graph_.first_edge[node + 1]; }

    bool is_risky() const {
        const auto positive = [](double risk) { return risk > 0.0; };
        return std::any_of(graph_.step_risk.begin(), graph_.step_risk.end(), positive) ||
               std::any_of(graph_.risk.begin(), graph_.risk.end(), positive);
    }

    bool is_by_chance() const {
        for (int edge = 0; edge < graph_.edges(); ++edge)
            if (graph_.step_risk[edge] > 0.0 && !(graph_.flags[edge] & UNSAFE)) return true;
        return false;
    }

    template <class Function>
    void for_each_allowed(int node, Function function) const {
        for (int edge = graph_.first_edge[node]; edge < graph_.first_edge[node + 1]; ++edge)
            if (allowed_[edge]) function(edge);
    }

    /// Returns the least risk of the allowed edges of a node.
    double least_risk(int node) const {
        double least = 2.0;
        for_each_allowed(node, [&](int edge) {
            least = std::min(least, lasting_risk(graph_, graph_.risk, edge, node,
                                                 preferences_.discount));
        });
        return least;
    }

    /// Finds the least risks, and leaves only the edges that have them, at least one of each node.
    void find_risks() {
        const double discount = preferences_.discount;
        // Until the end, the risk that is the fixed point from above: what never ends has failed.
        if (graph_.risk_kind[0] == UNTIL_END)
            std::fill_n(graph_.risk.begin(), graph_.expanded(), 1.0);
        iterate(graph_.risk, [this](int node) { return least_risk(node); });
        for_each_node(graph_, false, [&](int node) {
            double least = graph_.risk[node];
            if (!is_leaf(node)) least = std::max(least, least_risk(node));  // sweeps may not suffice
            for_each_allowed(node, [&](int edge) {
                const double risk = lasting_risk(graph_, graph_.risk, edge, node, discount);
                allowed_[edge] = risk <= least + ALIKE;
            });
            if (graph_.risk[node] <= ALIKE) graph_.risk[node] = 0.0;
        });
        for (int sweep = 0; sweep < sweeps_; ++sweep) {
            bool changed = false;
            for_each_node(graph_, sweep % 2 == 0, [&](int node) {
                if (is_leaf(node) || graph_.risk[node] == 0.0) return;
                std::int64_t longest = -1;
                for_each_allowed(node, [&](int edge) {
                    longest = std::max(longest, steps_through(graph_, edge));
                });
                changed = changed || longest != graph_.steps[node];
                graph_.steps[node] = longest;
            });
            if (!changed) break;
        }
        for_each_node(graph_, false, [&](int node) {  // all is lost there, but it may be put off
            if (graph_.risk[node] < 1.0 - ALIKE) return;
            std::int64_t longest = -1;
            for_each_allowed(node, [&](int edge) {
                longest = std::max(longest, steps_through(graph_, edge));
            });
            for_each_allowed(node, [&](int edge) {
                allowed_[edge] = steps_through(graph_, edge) == longest;
            });
        });
    }

    /// Sweeps over a column until no entry of an expanded node with edges changes.
    template <class Function>
    void iterate(std::vector<double>& column, Function entry) {
        for (int sweep = 0; sweep < sweeps_; ++sweep) {
            double change = 0.0;
            for_each_node(graph_, sweep % 2 == 0, [&](int node) {
                if (is_leaf(node)) return;
                const double now = entry(node);
                change = std::max(change, std::abs(now - column[node]));
                column[node] = now;
            });
            if (change <= EXACT) break;
        }
    }

    /// Finds the values of a policy that risks, from every node on, at most what is accepted more than
    /// the least. Nodes from which on it would risk more lose their slack, until there are none.
    void find_accepted_values() {
        const double discount = preferences_.discount;
        const std::vector<std::uint8_t> least = allowed_;
        std::vector<double> risk = graph_.risk;
        for (int round = 0; round <= BOUNDED; ++round) {
            for_each_node(graph_, false, [&](int node) {
                const int lowest = graph_.best_rank(node);
                for (int edge = graph_.first_edge[node]; edge < graph_.first_edge[node + 1]; ++edge)
                    allowed_[edge] = least[edge] || (rank_of(graph_.flags[edge]) == lowest &&
                                                     is_accepted(graph_, edge, node, preferences_));
            });
            find_values();
            iterate(risk, [&](int node) {
                return lasting_risk(graph_, risk, graph_.best[node], node, discount);
            });
            bool bounded = true;
            for_each_node(graph_, false, [&](int node) {
                const bool exceeds = risk[node] > graph_.risk[node] + preferences_.accepted + ALIKE;
                if (!graph_.slack[node] || !(exceeds || round == BOUNDED - 1)) return;
                graph_.slack[node] = 0;
                bounded = false;
            });
            if (bounded) return;
        }
    }

    /// Finds the values, by modified policy iteration (Puterman & Shin, "Modified policy iteration
    /// algorithms for discounted Markov decision problems", 1978): between two sweeps over all edges,
    /// some follow the best edges alone. Without a discount a policy may have several values, and all
    /// sweeps are over all edges.
    void find_values() {
        const double discount = preferences_.discount;
        double largest = 0.0;
        for (int sweep = 0; sweep < sweeps_; ++sweep) {
            double change = 0.0;
            largest = 0.0;
            const auto update = [&](int node, double value) {
                change = std::max(change, std::abs(value - graph_.value[node]));
                largest = std::max(largest, std::abs(value));
                graph_.value[node] = value;
            };
            for_each_node(graph_, sweep % 2 == 0, [&](int node) {
                if (is_leaf(node)) return;
                double most = -INF;
                for_each_allowed(node, [&](int edge) {
                    const double value = lasting_value(graph_, edge, node, discount);
                    if (value > most) most = value, graph_.best[node] = edge;
                });
                update(node, most);
            });
            if (change <= EXACT * largest) break;
            for (int k = 0; discount < 1.0 && k < POLICY_SWEEPS && change > EXACT * largest; ++k) {
                change = 0.0;
                for_each_node(graph_, k % 2 == 1, [&](int node) {
                    const int edge = graph_.best[node];
                    if (edge >= 0) update(node, lasting_value(graph_, edge, node, discount));
                });
            }
        }
        const double unit = ALIKE * largest;
        for_each_node(graph_, false, [&](int node) {
            double most = -INF;
            int best = -1;
            for_each_allowed(node, [&](int edge) {
                const double value = lasting_value(graph_, edge, node, discount);
                if (best < 0 || value > most + unit) most = value, best = edge;
            });
            graph_.best[node] = best;
        });
    }

    /// Marks the nodes whose best policy never leads to a node that is not expanded.
    void mark_inside() {
        for (bool changed = true; changed;) {
            changed = false;
            for_each_node(graph_, true, [&](int node) {
                const int edge = graph_.best[node];
                if (edge < 0 || !graph_.inside[node]) return;
                const int end = graph_.first_outcome[edge + 1];
                for (int k = graph_.first_outcome[edge]; k < end; ++k) {
                    if (graph_.target[k] < 0 || graph_.inside[graph_.target[k]]) continue;
                    graph_.inside[node] = 0;
                    changed = true;
                    return;
                }
            });
        }
    }

    Graph& graph_;
    const Preferences preferences_;
    const int sweeps_ = std::min(MOST_SWEEPS, OUTCOMES_FOLLOWED / std::max(1, graph_.outcomes()));
    std::vector<std::uint8_t> allowed_;  ///< [E] whether the best policy may take an edge
};

/// Rounds to a multiple of a unit, half to even.
double rounded(double number, double unit) {
    return unit > 0.0 ? std::nearbyint(number / unit) * unit : number;
}

/// Returns the score that an edge is chosen by.
PathScore score_of(const Graph& graph, int edge, int node, double discount, double unit) {
    double risk = lasting_risk(graph, graph.risk, edge, node, discount);
    risk = risk <= ALIKE ? 0.0 : rounded(risk, ALIKE);
    const std::int64_t steps = risk > 0.0 ? steps_through(graph, edge) : SAFE;
    const double value = rounded(lasting_value(graph, edge, node, discount), unit);
    return {rank_of(graph.flags[edge]), risk, steps, value};
}

/// Returns the risk of an edge that is taken once; 0 only if it is 0 in the score.
double shown_risk(const Graph& graph, int edge, double discount, const PathScore& score) {
    if (score.risk == 0.0) return 0.0;
    return std::max(ALIKE, rounded(lasting_risk(graph, graph.risk, edge, ONCE, discount), ALIKE));
}

int largest_of(const std::vector<PathScore>& scores) {
    int largest = 0;
    for (int k = 1; k < static_cast<int>(scores.size()); ++k)
        if (scores[k] > scores[largest]) largest = k;
    return largest;
}

}  // namespace

void solve(Graph& graph, Preferences preferences) {
    if (graph.nodes()) Solution(graph, preferences).find();
}

bool ends(const Graph& graph, int node) {
    for (int steps = 0; steps <= graph.nodes() && node >= 0; ++steps) {
        if (node >= graph.expanded() || graph.best[node] < 0) return false;
        node = graph.target[graph.first_outcome[graph.best[node]]];
        if (node == ENDED) return true;
    }
    return false;
}

void mark_dead_ends(Graph& graph) {
    graph.dead_end.assign(graph.nodes(), 0);
    bool backwards = false;
    for (bool changed = true; changed;) {
        changed = false;
        backwards = !backwards;
        for_each_node(graph, backwards, [&](int node) {
            if (graph.dead_end[node]) return;
            const int start = graph.first_edge[node], end = graph.first_edge[node + 1];
            bool lost = start < end || graph.undefined[node];
            const int lowest = graph.best_rank(node);
            for (int edge = start; edge < end && lost; ++edge)
                lost = rank_of(graph.flags[edge]) != lowest || is_certain(graph, edge);
            if (lost) graph.dead_end[node] = changed = true;
        });
    }
}

FirstActions look_up(const Graph& graph, int node, int actions, Preferences preferences,
                     double unit) {
    const auto [discount, accepted] = preferences;
    FirstActions first(actions);
    const int start = graph.first_edge[node], end = graph.first_edge[node + 1];
    if (start == end) return first;
    std::vector<PathScore> scores;
    const bool by_chance = graph.risk_kind[0] != CERTAIN;
    for (int edge = start; edge < end; ++edge) {
        scores.push_back(score_of(graph, edge, node, discount, unit));
        if (by_chance && !(graph.flags[edge] & UNSAFE))
            scores.back().rank = is_too_risky(graph, edge, node, preferences);
    }
    const int safest = largest_of(scores);
    const PathScore least = scores[safest];
    const double least_risk = shown_risk(graph, start + safest, discount, least);
    if (by_chance && accepted > 0.0)  // an accepted risk counts as that of the safest
        for (int edge = start; edge < end; ++edge) {
            PathScore& score = scores[edge - start];
            if (score.rank == least.rank && is_accepted(graph, edge, node, preferences))
                score = {least.rank, least.risk, least.steps, score.value};
        }
    const int chosen = start + largest_of(scores);
    const PathScore best = scores[chosen - start];
    const double most = rounded(lasting_value(graph, chosen, ONCE, discount), unit);
    for (int edge = start; edge < end; ++edge) {
        const PathScore& score = scores[edge - start];
        double value = rounded(lasting_value(graph, edge, ONCE, discount), unit);
        double risk = shown_risk(graph, edge, discount, score);
        if (score.rank == best.rank && score.risk == best.risk) {
            risk = least_risk;
            if (score.steps == best.steps)
                value = score.value == best.value ? most
                                                  : std::min(value, std::nextafter(most, -INF));
        } else if (score.rank == best.rank) {
            risk = std::max(risk, std::nextafter(least_risk, INF));
        }
        const int action = graph.action[edge];
        first.value[action] = value, first.path_risk[action] = risk;
        first.safe_steps[action] = score.steps, first.flags[action] = graph.flags[edge];
        first.reward[action] = graph.reward[edge];
        if (score.rank == 1) first.flags[action] |= RISKY;
        if (by_chance && score.rank == 0 && risk <= accepted) first.safe_steps[action] = SAFE;
    }
    first.choice = graph.action[chosen];
    return first;
}

}  // namespace serp
