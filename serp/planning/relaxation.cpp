#include "serp/planning/relaxation.hpp"

#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

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
    step_.resize(constant_.size());
    std::vector<std::vector<int>> users(facts_);
    for (const auto& [facts, cost, adds, action] : operators) {
        const int number = static_cast<int>(cost_.size());
        if (!(cost >= 0.0 && cost < INFINITE))
            throw std::invalid_argument("the cost of an operator is not usable");
        int needs = 0;
        for (const int fact : facts) {
            auto& its_users = users[checked(fact, facts_, "fact")];
            if (!its_users.empty() && its_users.back() == number) continue;
            its_users.push_back(number);
            needed_.add(fact);
            ++needs;
        }
        needed_.end_row();
        if (action < -1) throw std::invalid_argument("there is no action below -1");
        action_.push_back(action);
        if (needs == 0) free_.push_back(number);
        needs_.push_back(needs);
        cost_.push_back(cost);
        for (const Addition& addition : adds) {
            const auto [fact, gain, amount] = addition;
            const int base = 2 * fluents_;
            checked(fact, facts_, "fact");
            if (amount >= 0) checked(amount, facts_, "fact");
            if ((gain > 0.0 || amount >= 0) && (fact < base || (amount >= 0 && amount < base)))
                throw std::invalid_argument("a fact that is not a comparison has a gain");
            if (gain > 0.0) step_[fact - base] = std::max(step_[fact - base], gain);
            adds_.add(addition);
        }
        adds_.end_row();
    }
    for (const auto& its_users : users) {
        for (const int user : its_users) users_.add(user);
        users_.end_row();
    }
    for (const Way& way : ways) {
        for (const int fact : way) ways_.add(checked(fact, facts_, "fact"));
        ways_.end_row();
    }
}

RelaxedCosts::RelaxedCosts(const Relaxation& relaxation)
    : relaxation_(relaxation), cost_(relaxation.facts_), passed_(relaxation.facts_),
      gap_(relaxation.constant_.size()), queue_(relaxation.facts_ + 1),
      queued_(relaxation.facts_), sums_(relaxation.needs_.size()), by_(relaxation.facts_),
      paid_(relaxation.needs_.size()) {}

void RelaxedCosts::push(int fact) {
    if (queued_[fact]) return;
    queued_[fact] = 1;
    queue_[end_] = fact;
    if (++end_ == queue_.size()) end_ = 0;
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

/// Lowers the costs of what an operator makes true.
void RelaxedCosts::apply(int its_operator) {
    const int base = 2 * relaxation_.fluents_;
    for (const Relaxation::Addition& addition : relaxation_.adds_[its_operator]) {
        const int fact = std::get<0>(addition);
        const double gain = gain_of(addition);
        const double times = gain > 0.0 ? std::max(1.0, std::ceil(gap_[fact - base] / gain)) : 1.0;
        const double cost = sums_[its_operator] + times * relaxation_.cost_[its_operator];
        if (cost < cost_[fact] - 1e-9) {
            cost_[fact] = cost;
            by_[fact] = its_operator;
            push(fact);
        }
    }
}

/// Returns the sum of a comparison in a state.
double RelaxedCosts::total(int k, const double* state) const {
    double total = relaxation_.constant_[k];
    for (const auto& [fluent, factor] : relaxation_.terms_[k]) total += factor * state[fluent];
    return total;
}

/// Sets the costs of the facts that hold to 0, and puts them into the ring.
void RelaxedCosts::begin(const double* state) {
    const int base = 2 * relaxation_.fluents_;
    start_ = end_ = 0;
    std::fill(cost_.begin(), cost_.end(), INFINITE);
    std::fill(passed_.begin(), passed_.end(), INFINITE);
    std::fill(queued_.begin(), queued_.end(), 0);
    std::fill(by_.begin(), by_.end(), -1);
    for (int i = 0; i < relaxation_.fluents_; ++i) cost_[2 * i + (state[i] != 0.0)] = 0.0;
    for (std::size_t k = 0; k < gap_.size(); ++k) {
        gap_[k] = -total(k, state);
        if (met(k, -gap_[k])) cost_[base + k] = 0.0;
    }
    for (int fact = 0; fact < relaxation_.facts_; ++fact)
        if (cost_[fact] == 0.0 && !relaxation_.users_[fact].empty()) push(fact);
    missing_ = relaxation_.needs_;
    std::fill(sums_.begin(), sums_.end(), 0.0);
    for (const int its_operator : relaxation_.free_) apply(its_operator);
}

RelaxedCosts::Estimate RelaxedCosts::estimate(const double* state) {
    begin(state);
    updates_ = relaxation_.facts_ + static_cast<std::int64_t>(relaxation_.needs_.size());
    while (start_ != end_) {
        const int fact = queue_[start_];
        if (++start_ == queue_.size()) start_ = 0;
        queued_[fact] = 0;
        const double before = passed_[fact], cost = cost_[fact];
        passed_[fact] = cost;
        updates_ += 4 * static_cast<std::int64_t>(relaxation_.users_[fact].size());
        for (const int user : relaxation_.users_[fact]) {
            if (before == INFINITE) {
                --missing_[user];
                sums_[user] += cost;
            } else {
                sums_[user] += cost - before;
            }
            if (missing_[user] == 0) apply(user);
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
    open_.clear(), its_operators_.clear();
    if (relaxation_.ways_.size() == 0) return 0.0;
    take(relaxation_.ways_[cheapest_]);
    double total = 0.0;
    while (!open_.empty()) {
        const int fact = open_.back(), its_operator = by_[fact];
        open_.pop_back();
        if (its_operator < 0) continue;
        by_[fact] = -1;
        its_operators_.push_back(its_operator);
        const double more = cost_[fact] - sums_[its_operator] - paid_[its_operator];
        if (more > 0.0) paid_[its_operator] += more, total += more;
        if (sums_[its_operator] <= 0.0 && relaxation_.action_[its_operator] >= 0)
            actions[relaxation_.action_[its_operator]] = 1;
        take(relaxation_.needed_[its_operator]);
    }
    for (const int its_operator : its_operators_) paid_[its_operator] = 0.0;
    return total;
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
