// The best policy of a planning graph, by value iteration, and the forecast for one node.
#pragma once

#include "serp/planning/forecast.hpp"
#include "serp/planning/graph.hpp"

namespace serp {

/// Values that differ by less than this fraction of the largest are equal.
inline constexpr double ALIKE = 1e-7;

/// Weight of a reward one control period later, and the risk that is accepted.
struct Preferences {
    double discount, accepted;
};

/// Finds the best policy of every node.
///
/// The order of preferences is that of preference.hpp. Where the rewards alone lead to the end of the
/// task, the risk of a policy is the probability that it does not reach the end without damage: to
/// put the end off for ever is no way to avoid a risk (reach-avoid: Summers & Lygeros, Automatica
/// 2010). Elsewhere it is the probability of damage, discounted as rewards are. A policy that gains by
/// it may risk more than the least, up to `accepted` from every node on (constrained: Altman 1999).
/// Nodes that are not expanded have value and risk 0. Iteration goes on from the values in the graph.
void solve(Graph& graph, Preferences preferences);

/// Returns whether the best policy leads from a node to the end of the task. The first outcome of
/// every step is followed.
bool ends(const Graph& graph, int node);

/// Marks the nodes at which every action of the best rank is certain to do damage.
void mark_dead_ends(Graph& graph);

/// Returns the forecast for one expanded node of a solved graph.
///
/// The choice is made as in `solve`. The forecast is of an action that is taken once, with the best
/// policy from then on. Values are rounded to multiples of `unit`. Where rounding hides that another
/// action is worse than the choice, it differs by the least number that there is, so that the
/// forecast never contradicts the choice. Where damage is a matter of chance, RISKY marks an action
/// that risks more than is accepted beyond the least.
FirstActions look_up(const Graph& graph, int node, int actions, Preferences preferences,
                     double unit);

}  // namespace serp
