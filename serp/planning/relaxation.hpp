// The relaxed domain; goal_search.py says what it is and makes it.
#pragma once

#include <cstdint>
#include <functional>
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
    int last_action() const { return last_action_; }

private:
    friend class RelaxedCosts;

    int fluents_;
    int facts_;
    int last_action_ = -1;
    std::vector<double> constant_;       ///< of each comparison
    std::vector<std::uint8_t> strict_;   ///< of each comparison
    Rows<Term> terms_;                   ///< of each comparison
    std::vector<double> step_;           ///< of each comparison: most that an operator adds
    Rows<int> users_;                    ///< operators that need each fact
    Rows<int> needed_;                   ///< facts that each operator needs
    std::vector<int> action_;            ///< of each operator
    std::vector<int> free_;              ///< operators that need none
    std::vector<double> cost_;           ///< of each operator
    Rows<int> adds_;                     ///< facts that one application of each operator makes true
    Rows<Addition> gains_;               ///< what each operator adds to comparisons
    Rows<int> ways_;
    std::vector<std::uint8_t> is_goal_;  ///< of each fact: whether a way needs it
};

/// Facts that are true at some time on every relaxed way to the goal.
struct Landmarks {
    std::vector<int> facts;
    std::vector<std::uint8_t> lasting;  ///< whether the goal needs each in the end
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

    /// Returns the landmarks of a state [F]: of the facts of one relaxed plan those without which the
    /// goal is out of reach (Hoffmann, Porteous & Sebastia, "Ordered landmarks in planning", JAIR
    /// 2004). `work`: updates of costs.
    Landmarks landmarks(const double* state, std::int64_t& work);

private:
    double total(int k, const double* state) const;
    bool met(int k, double total) const {
        return total > 0.0 || (total == 0.0 && !relaxation_.strict_[k]);
    }
    double gain_of(const Relaxation::Addition& addition) const;
    void begin(const double* state);
    void apply(int its_operator);
    void lower(int fact, double cost, int its_operator);
    void push(double cost, int fact);

    /// Of an operator: the costs of its facts that were reached, and how many were not.
    struct Needs {
        double sum;
        int missing;
    };

    const Relaxation& relaxation_;
    std::vector<double> cost_;     ///< of each fact; infinite while it is unreachable
    std::vector<double> gap_;      ///< of each comparison: what the sum lacks
    /// Heap of facts whose operators are to be updated, and their costs.
    std::vector<std::pair<double, int>> queue_;
    std::vector<Needs> first_, needs_;  ///< of each operator: where nothing is reached, and now
    std::vector<int> by_;          ///< of each fact: the operator that makes it true at its cost
    std::vector<int> open_;        ///< scratch: facts of a relaxed plan
    std::vector<double> paid_;     ///< of each operator: its cost in a relaxed plan
    std::vector<int> its_operators_, plan_facts_;  ///< scratch: operators and facts of a relaxed plan
    std::int64_t updates_ = 0;
    int forbidden_ = -1;           ///< a fact that nothing makes true
    std::size_t cheapest_ = 0;     ///< the way of the least cost
};

}  // namespace serp
