// The planning graph of one state with a depth, thrown away after the decision.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "serp/model/model.hpp"
#include "serp/planning/cells.hpp"
#include "serp/planning/forecast.hpp"
#include "serp/planning/hash_table.hpp"
#include "serp/planning/preference.hpp"

namespace serp {

/// Depth, preferences and budgets of a lookahead.
struct LookaheadRules {
    int depth;
    double discount, accepted;
    int max_nodes;           ///< most nodes that are expanded
    std::int64_t max_edges;  ///< most edges, from the second layer on
};

/// A forecast, layers that were expanded, what ended that, and edges that were followed for it.
struct LookaheadForecast {
    FirstActions first;
    int depth = 0;
    Bound bound = Bound::DEPTH;
    std::int64_t followed = 0;
};

/// Monitor-replanning for use in every step of a training: searches from one state at a time. Has
/// scratch memory, which is bounded by the budgets: one for each thread.
class Lookahead {
public:
    /// The model must outlive the lookahead.
    Lookahead(const Model& model, const LookaheadRules& rules);
    Lookahead(const Lookahead&) = delete;

    /// Expands the planning graph of a state [F] and finds the best path of every first action.
    ///
    /// `leaves` are the values of the states that the last layer leads to; 0 without. Where a budget
    /// ends the expansion, leaves are worth 0.
    LookaheadForecast forecast(const double* state, const CellValues* leaves);

    /// Finds out only whether a path without risk begins with each first action of a state [F], to
    /// the depth of the lookahead or the end of the task: depth-first, up to the first such path.
    ///
    /// Flags and rewards are those of `forecast`, values are NaN, and no action is chosen. Where the
    /// bound is SAFETY, some path is without risk, and for actions without a risk of their own `SAFE`
    /// in `safe_steps` is what `forecast` gives. With another bound it is not known.
    LookaheadForecast check_safety(const double* state);

    /// Returns the forecasts for states [B, F], computed by so many threads.
    std::vector<LookaheadForecast> forecast_batch(const double* states, int count,
                                                  const CellValues* leaves, int threads);

    /// The best path from a state, and its first action; -1 where none is applicable.
    struct Path {
        double value = 0.0, risk = 0.0;
        std::int64_t steps = SAFE;
        std::int32_t action = -1;
    };
    /// Returns the best paths from the states of the newest forecast that were expanded, in the order
    /// in which they were found.
    const std::vector<Path>& paths() const { return paths_; }
    int width() const { return width_; }

    bool farther_ = false;  ///< whether a first action is safe only if it leaves enough ways on

private:
    /// An edge from a node to the next layer.
    struct Edge {
        double reward, risk;
        double chance;               ///< of what the file says, where something else is likelier
        std::int32_t child, written;  ///< the nodes that likeliest and file lead to; -1 for none
        std::uint8_t flags, rank;
        std::uint16_t end;  ///< the learned chance that the task ends, as in `Flags`
    };

    double value_after(const Edge& edge, int expanded) const;
    bool expand(int start, int end, int depth, const CellValues* leaves, LookaheadForecast& found);
    void follow(const Steps& steps, std::ptrdiff_t lane, int node, int action, int depth,
                const CellValues* leaves, LookaheadForecast& found);
    int child_of(int position);
    void choose(int node, int expanded, FirstActions& first);
    bool look_farther(const double* state, LookaheadForecast& found, int depth);
    int ways_on(int horizon, std::int64_t& followed, std::int64_t limit);
    bool safe_path_from(const double* state, int depth, std::int64_t& followed);

    double* state_at(int position) {
        return states_.data() + static_cast<std::size_t>(position) * (width_ + 1);
    }

    const Model& model_;
    const LookaheadRules rules_;
    const int width_, actions_;
    const std::unique_ptr<Stepper> stepper_;
    int stored_ = 0;              ///< N, nodes that were found
    std::vector<double> states_;  ///< [(N + 1) * (F + 1)] each followed by a reward
    std::vector<double> ways_;    ///< [(periods + 3) * (F + 1)] scratch: states along a way
    std::vector<Edge> edges_;     ///< [N * A]
    std::vector<Path> paths_;     ///< of the expanded nodes
    HashTable table_;             ///< of the next layer
    std::vector<std::unique_ptr<Lookahead>> others_;  ///< of the other threads
};

}  // namespace serp
