// A planning graph in columns, and an index of its nodes by their states.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "serp/model/flags.hpp"
#include "serp/planning/hash_table.hpp"
#include "serp/planning/preference.hpp"

namespace serp {

/// In place of the node that an outcome leads to: the task ends.
inline constexpr std::int32_t ENDED = -1;

/// Updates of relaxed costs that take as long as an edge of a graph, about 2 µs. All other work is
/// counted as so many updates as it was measured to take.
inline constexpr std::int64_t WORK = 512;

/// What the risks of a graph are: damage is certain or does not happen; the probability of damage,
/// discounted; the probability that the task does not end without damage.
inline constexpr std::uint8_t CERTAIN = 0, DISCOUNTED = 1, UNTIL_END = 2;

/// A planning graph of N nodes, E edges and O outcomes. The first `expanded` nodes have edges: those
/// of node n are `first_edge[n]` to `first_edge[n + 1]`, and outcomes of edges likewise.
///
/// How nodes are found, by their states or by cells, is the matter of an index beside it.
struct Graph {
    int width = 0;  ///< fluents of a state, F

    std::vector<double> states;           ///< [N * F]
    std::vector<std::int32_t> layer;      ///< [N] edges from the first node on the way to a node
    std::vector<std::uint8_t> undefined;  ///< [N] whether the result of an action is undefined

    std::vector<std::int32_t> first_edge{0};     ///< [expanded + 1]
    std::vector<std::int32_t> action;            ///< [E]
    std::vector<Flags> flags;                    ///< [E]
    std::vector<double> reward;                  ///< [E]
    std::vector<double> step_risk;               ///< [E] probability of damage in the step
    std::vector<double> going_on;                ///< [E] learned probability that the task goes on
    std::vector<std::int32_t> first_outcome{0};  ///< [E + 1]
    std::vector<std::int32_t> target;            ///< [O] node that an outcome leads to, or ENDED
    std::vector<double> chance;                  ///< [O] its probability

    // Of the best policy, see `Forecast`; made by `solve`.
    std::vector<double> value, risk;     ///< [N]
    std::vector<std::int64_t> steps;     ///< [N]
    std::vector<std::int32_t> best;      ///< [N] its edge; -1 where no action is applicable
    std::vector<std::uint8_t> inside;    ///< [N] whether it stays among expanded nodes
    std::vector<std::uint8_t> slack;     ///< [N] whether more than the least may be risked there
    std::vector<std::uint8_t> risk_kind{0};  ///< [1] see below
    std::vector<std::uint8_t> dead_end;  ///< [N] whether damage is certain, whatever is done

    int nodes() const { return static_cast<int>(layer.size()); }
    int expanded() const { return static_cast<int>(first_edge.size()) - 1; }
    int edges() const { return static_cast<int>(action.size()); }
    int outcomes() const { return static_cast<int>(target.size()); }
    /// Bytes of all columns.
    std::size_t bytes() const {
        return layer.size() * (8 * static_cast<std::size_t>(width) + 44) + action.size() * 40 +
               target.size() * 12;
    }
    const double* state(int node) const {
        return states.data() + static_cast<std::size_t>(node) * width;
    }

    /// Forgets all nodes; memory is kept.
    void clear() {
        states.clear(), layer.clear(), undefined.clear();
        first_edge.assign(1, 0), action.clear(), flags.clear(), reward.clear(), step_risk.clear();
        going_on.clear();
        first_outcome.assign(1, 0), target.clear(), chance.clear();
        value.clear(), risk.clear(), steps.clear(), best.clear(), inside.clear(), dead_end.clear();
        slack.clear(), risk_kind.assign(1, CERTAIN);
    }

    /// Adds a node with a state [F], which lies outside `states`; returns it.
    int add_node(const double* row, int at_layer = 0) {
        states.insert(states.end(), row, row + width);
        layer.push_back(at_layer);
        undefined.push_back(0);
        return nodes() - 1;
    }

    /// Adds an edge, without outcomes, to the node after those that are expanded; returns it.
    int add_edge(int its_action, Flags its_flags, double its_step_risk) {
        action.push_back(its_action);
        flags.push_back(its_flags);
        step_risk.push_back(its_step_risk);
        reward.push_back(0.0);
        going_on.push_back(1.0);
        first_outcome.push_back(outcomes());
        return edges() - 1;
    }

    /// Adds an outcome to the newest edge.
    void add_outcome(std::int32_t its_target, double its_chance) {
        target.push_back(its_target);
        chance.push_back(its_chance);
        first_outcome.back() = outcomes();
    }

    /// Ends the expansion of a node: its edges are complete.
    void end_node() { first_edge.push_back(edges()); }

    /// Returns the least rank of the edges of an expanded node; 3 where it has none.
    int best_rank(int node) const {
        int rank = 3;
        for (int edge = first_edge[node]; edge < first_edge[node + 1]; ++edge)
            rank = std::min(rank, rank_of(flags[edge]));
        return rank;
    }
};

/// Nodes by their states; equal states are one node.
class StateIndex {
public:
    void clear() { table_.clear(); }

    /// Returns the node with a state [F]; -1 if there is none.
    int find(const Graph& graph, const double* row) const {
        return table_.find(digest_of_row(row, graph.width), [&graph, row](int node) {
            return equal(graph, row, node);
        });
    }

    /// Returns the node with a state [F], which lies outside the graph, adding it where there is
    /// none.
    int find_or_add(Graph& graph, const double* row, int layer) {
        const int next = graph.nodes(), node = place(graph, row, next);
        return node == next ? graph.add_node(row, layer) : node;
    }

    /// Finds all nodes of a graph from now on. Of equal states the first is found.
    void index(const Graph& graph) {
        table_.clear(graph.nodes());
        for (int node = 0; node < graph.nodes(); ++node) place(graph, graph.state(node), node);
    }

private:
    static bool equal(const Graph& graph, const double* row, int node) {
        return std::equal(row, row + graph.width, graph.state(node),
                          [](double a, double b) { return bits_of(a) == bits_of(b); });
    }

    int place(const Graph& graph, const double* row, int node) {
        return table_.find_or_add(
            digest_of_row(row, graph.width), node,
            [&graph, row](int other) { return equal(graph, row, other); },
            [&graph](int other) { return digest_of_row(graph.state(other), graph.width); });
    }

    HashTable table_;
};

}  // namespace serp
