// The closed planning graph: all states that can be reached, and the best action in each.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "serp/model/model.hpp"
#include "serp/planning/value_iteration.hpp"

namespace serp {

/// A planning graph in which all equal states are one node, so that the graph of a finite task is
/// finite, and a plan sees to its end.
///
/// Values of inert fluents make no difference; they are 0 in all states of the graph.
class ClosedGraph {
public:
    /// The model must outlive the graph.
    ClosedGraph(const Model& model, Preferences preferences);

    /// Forgets all nodes. `inert` are columns of fluents; a std::invalid_argument says that one is
    /// not there.
    void clear(std::vector<std::int64_t> inert);

    /// Takes a graph with these nodes, edges and outcomes, solved but for `best` and `dead_end`.
    /// A std::invalid_argument says what does not fit together; this graph is then empty.
    void restore(Graph&& graph);

    /// Adds states [n, F] and what can be reached from them, breadth first, and solves the graph.
    /// Where it would become too large, the nodes with the most actions on the way to them are not
    /// expanded. In an empty graph all of the states are. `limit`: most work.
    void grow(const double* states, int count, std::int64_t limit);

    void solve();

    /// Returns the forecast for a state [F]; none where the state is not in the graph, or its best
    /// policy leaves the graph.
    std::optional<FirstActions> forecast(const double* state);

    /// Returns whether the best policy leads from a state [F] to the end of the task. The first
    /// outcome of every step is followed.
    bool ends(const double* state) const;

    /// Returns whether edges hardly ever lead to a known state, so that the graph will not close.
    /// Where many actions are applicable, ways meet only after as many nodes.
    bool spreads() const;

    /// Returns the edges that take as long to follow as the graph took to grow; its own or more.
    std::int64_t work() const;
    /// Returns whether everything that can be reached is in the graph.
    bool complete() const { return graph_.nodes() == graph_.expanded(); }
    /// Returns the most edges on the way to a node.
    int depth() const { return depth_; }
    const Graph& graph() const { return graph_; }
    const std::vector<std::int64_t>& inert() const { return inert_; }

private:
    void expand_node();
    void add_outcome(double* row, Flags flags, double chance, int layer);
    void measure();
    int find(const double* state) const;

    const Model& model_;
    const std::unique_ptr<Stepper> stepper_;
    const Preferences preferences_;
    Graph graph_;
    StateIndex index_;
    std::vector<std::int64_t> inert_;
    double unit_ = 0.0;  ///< values are shown as multiples of this
    int depth_ = 0;
    std::vector<double> source_;  ///< [F] scratch: the state that is expanded
    std::vector<double> rows_;    ///< [OUTCOMES * (F + 3)] scratch: its outcomes
};

}  // namespace serp
