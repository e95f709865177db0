#include "serp/planning/relaxation.hpp"

#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "serp/_util/arrays.hpp"

namespace serp {

namespace {

constexpr double INFINITE = std::numeric_limits<double>::infinity();

int checked(int position, int end, const char* what) {
    if (position < 0 || position >= end)
        throw std::invalid_argument("there is no " + std::string(what) + " " +
                                    std::to_string(position));
    return position;
}

}  // namespace

Relaxation::Relaxation(int fluents, const std::vector<Comparison>& comparisons,
                       const std::vector<Operator>& operators, const std::vector<Way>& ways)
    : fluents_(fluents), facts_(2 * fluents + static_cast<int>(comparisons.size())) {
    if (fluents < 0) throw std::invalid_argument("the number of fluents is negative");
    for (const auto& [terms, constant, strict] : comparisons) {
        constant_.push_back(constant);
        strict_.push_back(strict);
        for (const Term& term : terms) {
            checked(term.first, fluents_, "fluent");
            terms_.add(term);
        }
        terms_.end_row();
    }
    const int base = 2 * fluents_;
    std::vector<std::vector<int>> users(facts_), makers(facts_);
    for (int number = 0; const auto& [facts, cost, adds, action] : operators) {
        if (!(cost >= 0.0 && cost < INFINITE))
            throw std::invalid_argument("the cost of an operator is not usable");
        if (action < -1) throw std::invalid_argument("there is no action below -1");
        last_action_ = std::max(last_action_, action);
        for (const int fact : facts) checked(fact, facts_, "fact");
        for (const auto& [fact, gain, amount] : adds) {
            makers[checked(fact, facts_, "fact")].push_back(number);
            if (amount >= 0) checked(amount, facts_, "fact");
            if ((gain > 0.0 || amount >= 0) && (fact < base || (amount >= 0 && amount < base)))
                throw std::invalid_argument("a fact that is not a comparison has a gain");
        }
        ++number;
    }
    is_goal_.resize(facts_);
    for (const Way& way : ways) {
        for (const int fact : way) ways_.add(checked(fact, facts_, "fact")), is_goal_[fact] = 1;
        ways_.end_row();
    }
    // Other facts and operators than those that the goal may need make no difference.
    std::vector<std::uint8_t> relevant = is_goal_, used(operators.size());
    std::vector<int> open;
    for (int fact = 0; fact < facts_; ++fact)
        if (relevant[fact]) open.push_back(fact);
    while (!open.empty()) {
        const int made = open.back();
        open.pop_back();
        for (const int number : makers[made]) {
            if (std::exchange(used[number], 1)) continue;
            for (const int fact : std::get<0>(operators[number]))
                if (!std::exchange(relevant[fact], 1)) open.push_back(fact);
        }
    }
    step_.resize(constant_.size());
    for (std::size_t number = 0; number < operators.size(); ++number) {
        if (!used[number]) continue;
        const auto& [facts, cost, adds, action] = operators[number];
        const int kept = static_cast<int>(cost_.size());
        for (const int fact : facts) {
            if (!users[fact].empty() && users[fact].back() == kept) continue;
            users[fact].push_back(kept);
            needed_.add(fact);
        }
        needed_.end_row();
        if (facts.empty()) free_.push_back(kept);
        action_.push_back(action);
        cost_.push_back(cost);
        for (const auto& [fact, gain, amount] : adds) {
            if (!relevant[fact]) continue;
            if (gain > 0.0) step_[fact - base] = std::max(step_[fact - base], gain);
            if (gain > 0.0 || amount >= 0)
                gains_.add({fact, gain, amount});
            else
                adds_.add(fact);
        }
        adds_.end_row(), gains_.end_row();
    }
    for (const auto& its_users : users) {
        for (const int user : its_users) users_.add(user);
        users_.end_row();
    }
}

RelaxedCosts::RelaxedCosts(const Relaxation& relaxation)
    : relaxation_(relaxation), cost_(relaxation.facts_),
      gap_(relaxation.constant_.size()), by_(relaxation.facts_), paid_(relaxation.cost_.size()) {
    for (std::size_t k = 0; k < paid_.size(); ++k)
        first_.push_back({0.0, static_cast<int>(relaxation.needed_[k].size())});
}

/// Returns what one application adds to a sum; 0 where one is enough. Where that depends on the
/// state and is not positive yet, it is what it becomes first by the largest steps.
double RelaxedCosts::gain_of(const Relaxation::Addition& addition) const {
    const auto [fact, gain, amount] = addition;
    if (amount < 0) return gain;
    const int k = amount - 2 * relaxation_.fluents_;
    const double lacks = gap_[k], step = relaxation_.step_[k];
    if (lacks < 0.0) return -lacks;
    return step > 0.0 ? step * (std::floor(lacks / step) + 1.0) - lacks : 0.0;
}

void RelaxedCosts::push(double cost, int fact) {
    queue_.push_back({cost, fact});
    std::push_heap(queue_.begin(), queue_.end(), std::greater<>());
}

/// Lowers the cost of a fact to what it takes by an operator.
void RelaxedCosts::lower(int fact, double cost, int its_operator) {
    if (!(cost < cost_[fact] - 1e-9) || fact == forbidden_) return;
    cost_[fact] = cost;
    by_[fact] = its_operator;
    push(cost, fact);
}

/// Lowers the costs of what an operator makes true.
void RelaxedCosts::apply(int its_operator) {
    const double sum = needs_[its_operator].sum, cost = relaxation_.cost_[its_operator];
    const auto adds = relaxation_.adds_[its_operator];
    const auto gains = relaxation_.gains_[its_operator];
    updates_ += 2 * static_cast<std::int64_t>(adds.size() + gains.size());
    for (const int fact : adds) lower(fact, sum + cost, its_operator);
    for (const Relaxation::Addition& addition : gains) {
        const int fact = std::get<0>(addition);
        const double gain = gain_of(addition), gap = gap_[fact - 2 * relaxation_.fluents_];
        const double times = gain > 0.0 ? std::max(1.0, std::ceil(gap / gain)) : 1.0;
        lower(fact, sum + times * cost, its_operator);
    }
}

/// Returns the sum of a comparison in a state.
double RelaxedCosts::total(int k, const double* state) const {
    double total = relaxation_.constant_[k];
    for (const auto& [fluent, factor] : relaxation_.terms_[k]) total += factor * state[fluent];
    return total;
}

/// Sets the costs of the facts that hold to 0, and puts them into the queue.
void RelaxedCosts::begin(const double* state) {
    const int base = 2 * relaxation_.fluents_;
    updates_ = relaxation_.facts_ + static_cast<std::int64_t>(first_.size()) / 2;
    std::fill(cost_.begin(), cost_.end(), INFINITE);
    std::fill(by_.begin(), by_.end(), -1);
    for (int i = 0; i < relaxation_.fluents_; ++i) cost_[2 * i + (state[i] != 0.0)] = 0.0;
    for (std::size_t k = 0; k < gap_.size(); ++k) {
        gap_[k] = -total(k, state);
        if (met(k, -gap_[k])) cost_[base + k] = 0.0;
    }
    queue_.clear();
    for (int fact = 0; fact < relaxation_.facts_; ++fact)
        if (cost_[fact] == 0.0 && (relaxation_.is_goal_[fact] || !relaxation_.users_[fact].empty()))
            queue_.push_back({0.0, fact});
    needs_ = first_;
    for (const int its_operator : relaxation_.free_) apply(its_operator);
}

RelaxedCosts::Estimate RelaxedCosts::estimate(const double* state) {
    begin(state);
    const auto& is_goal = relaxation_.is_goal_;
    auto goals = std::count(is_goal.begin(), is_goal.end(), 1);
    while (!queue_.empty() && goals > 0) {  // the least cost first: it is final (Dijkstra)
        const auto [cost, fact] = queue_.front();
        std::pop_heap(queue_.begin(), queue_.end(), std::greater<>());
        queue_.pop_back();
        updates_ += 16;
        if (cost > cost_[fact]) continue;
        goals -= is_goal[fact];
        updates_ += static_cast<std::int64_t>(relaxation_.users_[fact].size());
        for (const int user : relaxation_.users_[fact]) {
            needs_[user].sum += cost;
            if (--needs_[user].missing == 0) apply(user);
        }
    }
    Estimate found{INFINITE, relaxation_.facts_};
    for (std::size_t way = 0; way < relaxation_.ways_.size(); ++way) {
        double cost = 0.0;
        int lacks = 0;
        for (const int fact : relaxation_.ways_[way]) {
            cost += cost_[fact];
            lacks += cost_[fact] > 0.0;
        }
        if (cost < found.cost) cheapest_ = way;
        found.cost = std::min(found.cost, cost);
        found.left = std::min(found.left, lacks);
    }
    return found;
}

bool RelaxedCosts::holds(int fact, const double* state) const {
    const int base = 2 * relaxation_.fluents_;
    if (fact < base) return (state[fact / 2] != 0.0) == (fact % 2 != 0);
    return met(fact - base, total(fact - base, state));
}

int RelaxedCosts::lacking(const double* state) const {
    int least = relaxation_.facts_;
    for (std::size_t way = 0; way < relaxation_.ways_.size(); ++way) {
        const auto facts = relaxation_.ways_[way];
        least = std::min(least, static_cast<int>(std::count_if(
            facts.begin(), facts.end(), [&](int fact) { return !holds(fact, state); })));
    }
    return least;
}

double RelaxedCosts::relaxed_plan(std::vector<std::uint8_t>& actions) {
    const auto take = [this](const auto& needed) {  // each fact once
        for (const int fact : needed)
            if (by_[fact] >= 0) open_.push_back(fact);
    };
    open_.clear(), its_operators_.clear(), plan_facts_.clear();
    if (relaxation_.ways_.size() == 0) return 0.0;
    take(relaxation_.ways_[cheapest_]);
    double total = 0.0;
    while (!open_.empty()) {
        const int fact = open_.back(), its_operator = by_[fact];
        open_.pop_back();
        if (its_operator < 0) continue;
        by_[fact] = -1;
        its_operators_.push_back(its_operator);
        plan_facts_.push_back(fact);
        const double more = cost_[fact] - needs_[its_operator].sum - paid_[its_operator];
        if (more > 0.0) paid_[its_operator] += more, total += more;
        if (needs_[its_operator].sum <= 0.0 && relaxation_.action_[its_operator] >= 0)
            actions[relaxation_.action_[its_operator]] = 1;
        take(relaxation_.needed_[its_operator]);
    }
    for (const int its_operator : its_operators_) paid_[its_operator] = 0.0;
    return total;
}

Landmarks RelaxedCosts::landmarks(const double* state, std::int64_t& work) {
    Landmarks found;
    const double cost = estimate(state).cost;
    work += updates_;
    if (cost == INFINITE || relaxation_.ways_.size() == 0) return found;
    std::vector<std::uint8_t> helpful(relaxation_.last_action() + 1);
    relaxed_plan(helpful);
    for (const int fact : plan_facts_) {  // an estimate leaves the relaxed plan as it is
        forbidden_ = fact;
        const bool needed = estimate(state).cost == INFINITE;
        work += updates_;
        if (!needed) continue;
        const auto needs = [&](std::size_t way) {
            const auto facts = relaxation_.ways_[way];
            return std::find(facts.begin(), facts.end(), fact) != facts.end();
        };
        found.facts.push_back(fact);
        found.lasting.push_back(1);
        for (std::size_t way = 0; way < relaxation_.ways_.size(); ++way)
            found.lasting.back() &= needs(way);
    }
    forbidden_ = -1;
    if (relaxation_.ways_.size() > 1) return found;
    for (const int fact : relaxation_.ways_[0])
        if (holds(fact, state)) found.facts.push_back(fact), found.lasting.push_back(1);
    return found;
}

// For Python ---------------------------------------------------------------------------------------

namespace {

std::pair<double, int> estimate(const Relaxation& relaxation,
                                const In<double, nb::ndim<1>>& state) {
    const double* numbers = state_of(state, relaxation.fluents());
    const auto [cost, left] = RelaxedCosts(relaxation).estimate(numbers);
    return {cost, left};
}

}  // namespace

void bind_relaxation(nb::module_& module) {
    nb::class_<Relaxation>(module, "Relaxation",
                           "Facts and operators of a relaxed domain, see relaxation.hpp.")
        .def(nb::init<int, const std::vector<Relaxation::Comparison>&,
                      const std::vector<Relaxation::Operator>&,
                      const std::vector<Relaxation::Way>&>(),
             nb::arg("fluents"), nb::arg("comparisons"), nb::arg("operators"), nb::arg("ways"))
        .def("estimate", &estimate, nb::arg("state"));
}

}  // namespace serp
