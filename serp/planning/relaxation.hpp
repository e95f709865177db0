// The relaxed domain; goal_search.py says what it is and makes it.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <span>
#include <tuple>
#include <utility>
#include <vector>

namespace serp {

/// Rows of different lengths, one after the other.
template <class Item>
class Rows {
public:
    std::size_t size() const { return first_.size() - 1; }

    std::span<const Item> operator[](std::size_t row) const {
        return {items_.data() + first_[row], items_.data() + first_[row + 1]};
    }

    /// Adds an item to the newest row.
    void add(const Item& item) { items_.push_back(item); }

    /// Ends the newest row.
    void end_row() { first_.push_back(items_.size()); }

private:
    std::vector<std::size_t> first_{0};
    std::vector<Item> items_;
};

/// Facts and operators. Facts `2 i` and `2 i + 1` say that fluent i is 0, or is not; the others are
/// comparisons: that a sum of factors times fluents and a constant is at least 0, or positive.
class Relaxation {
public:
    /// A fluent and its factor.
    using Term = std::pair<int, double>;
    /// Terms of a comparison, its constant, and whether the sum has to be positive.
    using Comparison = std::tuple<std::vector<Term>, double, bool>;
    /// A fact that becomes true. For a comparison, what one application adds to its sum; 0 where
    /// one is enough. What is added may depend on the state: it is then the sum of another
    /// comparison, whose fact is the third entry; else -1.
    using Addition = std::tuple<int, double, int>;
    /// The facts that are needed, the cost, the facts that become true, and the action; -1 for none.
    using Operator = std::tuple<std::vector<int>, double, std::vector<Addition>, int>;
    using Way = std::vector<int>;

    /// `ways` are those to reach the goal: the facts that each needs.
    /// Throws std::invalid_argument where a fact or fluent is not there, or a cost is negative.
    Relaxation(int fluents, const std::vector<Comparison>& comparisons,
               const std::vector<Operator>& operators, const std::vector<Way>& ways);

    int fluents() const { return fluents_; }
    /// Returns the largest action of an operator; -1 where none has one.
    int last_action() const {
        return action_.empty() ? -1 : *std::max_element(action_.begin(), action_.end());
    }

private:
    friend class RelaxedCosts;

    int fluents_;
    int facts_;
    std::vector<double> constant_;       ///< of each comparison
    std::vector<std::uint8_t> strict_;   ///< of each comparison
    Rows<Term> terms_;                   ///< of each comparison
    std::vector<double> step_;           ///< of each comparison: most that an operator adds
    Rows<int> users_;                    ///< operators that need each fact
    Rows<int> needed_;                   ///< facts that each operator needs
    std::vector<int> needs_;             ///< their number
    std::vector<int> action_;            ///< of each operator
    std::vector<int> free_;              ///< operators that need none
    std::vector<double> cost_;           ///< of each operator
    Rows<Addition> adds_;                ///< of each operator
    Rows<int> ways_;
};

/// Finds how far away the goal is, with scratch memory of its own.
class RelaxedCosts {
public:
    struct Estimate {
        double cost;  ///< additive cost of the cheapest way; infinite if none can be reached
        int left;     ///< least number of facts of a way that do not hold
    };

    explicit RelaxedCosts(const Relaxation& relaxation);

    /// Returns the estimate for a state [F].
    Estimate estimate(const double* state);

    /// Returns how many costs of operators the newest estimate updated.
    std::int64_t updates() const { return updates_; }

    /// Returns whether a fact holds in a state [F].
    bool holds(int fact, const double* state) const;

    /// Returns the least number of facts of a way that do not hold in a state [F].
    int lacking(const double* state) const;

    /// Marks the helpful actions of the state that was estimated last: those of the relaxed plan, by
    /// the cheapest operator for each fact, that need no other one (Hoffmann & Nebel, 2001). Returns
    /// the cost of the plan, where each operator counts as often as the fact needs it that needs it
    /// most.
    double relaxed_plan(std::vector<std::uint8_t>& actions);

private:
    double total(int k, const double* state) const;
    bool met(int k, double total) const {
        return total > 0.0 || (total == 0.0 && !relaxation_.strict_[k]);
    }
    double gain_of(const Relaxation::Addition& addition) const;
    void begin(const double* state);
    void apply(int its_operator);
    void push(int fact);

    const Relaxation& relaxation_;
    std::vector<double> cost_;     ///< of each fact; infinite while it is unreachable
    std::vector<double> passed_;   ///< the cost of each fact that its operators know
    std::vector<double> gap_;      ///< of each comparison: what the sum lacks
    std::vector<int> queue_;       ///< facts whose operators are to be updated, a ring
    std::vector<std::uint8_t> queued_;  ///< whether each fact is in it
    std::vector<int> missing_;     ///< of each operator: facts that are unreachable
    std::vector<double> sums_;     ///< of each operator: costs of the others
    std::vector<int> by_;          ///< of each fact: the operator that makes it true at its cost
    std::vector<int> open_;        ///< scratch: facts of a relaxed plan
    std::vector<double> paid_;     ///< of each operator: its cost in a relaxed plan
    std::vector<int> its_operators_;  ///< scratch: operators of a relaxed plan
    std::int64_t updates_ = 0;
    std::size_t cheapest_ = 0;     ///< the way of the least cost
    std::size_t start_ = 0, end_ = 0;  ///< of the ring
};

}  // namespace serp
