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
/// The order of preferences is that of preference.hpp; the risks of later steps are discounted, as
/// rewards are (lexicographic value iteration: Wray, Zilberstein & Mouaddib, AAAI 2015). A risk
/// within the slack of the least, by what follows at the least risk, counts as the least. Nodes that
/// are not expanded have value and risk 0. Iteration goes on from the values in the graph.
void solve(Graph& graph, Preferences preferences);

/// Marks the nodes at which every action of the best rank is certain to do damage.
void mark_dead_ends(Graph& graph);

/// Returns the forecast for one expanded node of a solved graph.
///
/// The choice is made as in `solve`. The forecast is of an action that is taken once, with the best
/// policy from then on. Values are rounded to multiples of `unit`. Where rounding hides that another
/// action is worse than the choice, it differs by the least number that there is, so that the
/// forecast never contradicts the choice.
FirstActions look_up(const Graph& graph, int node, int actions, Preferences preferences,
                     double unit);

}  // namespace serp
