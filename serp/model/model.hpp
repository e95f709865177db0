// A model as planners see it.
#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <vector>

#include "serp/model/flags.hpp"

namespace serp {

/// Most outcomes of one step, see `Stepper::outcomes`; callers make room for them.
inline constexpr int OUTCOMES = 16;
/// Uncertainty from which on nothing is known of a step: the data say less than the prior.
inline constexpr double UNKNOWN = 0.5;

/// Steps of all actions from the first of some states, see `Stepper::steps`. That of an action from
/// state k is in lane action * apart + k.
struct Steps {
    int states, apart;
    const Flags* flags;        ///< [lanes]
    const double* numbers;     ///< of the first lane: next state [F] and reward
    std::ptrdiff_t row, lane;  ///< from a number to the next one of its lane; to that of the next lane
    /// [lanes] probability of what the file says where a learned outcome is likelier, and [lanes, F + 1]
    /// the state that it leads to; none where no lane has any.
    const double *chances = nullptr, *written = nullptr;
};

/// Predicts steps of a model, with scratch memory of its own. Not thread-safe: one for each thread.
class Stepper {
public:
    virtual ~Stepper() = default;

    /// Sets the state [F] that the next calls start from. It is read at that address until the next
    /// call of `from`, and must not change before that.
    virtual void from(const double* state) = 0;

    /// Predicts the step of an action. Writes the next state and the reward to `out` [F + 1], which
    /// must not overlap the state; the numbers mean nothing where the step is not applicable.
    virtual Flags step(int action, double* out) = 0;

    /// Predicts what `step` does for all actions and the first of `count` states, in rows of F + 1
    /// numbers; at least for one. Valid until the next call.
    virtual Steps steps(const double* states, int count) = 0;

    /// Predicts all outcomes of an applicable action. Writes rows of F + 3 numbers: next state,
    /// reward, flags and probability. Returns how many there are, at most OUTCOMES.
    virtual int outcomes(int action, double* rows) = 0;

    /// Returns how far a step is from the data, in [0, 1]; 0 where the file alone predicts.
    virtual double uncertainty(int /*action*/) { return 0.0; }

protected:
    /// Writes what outcomes come to: the likeliest next state, and the expected reward. Returns the
    /// flags: UNSAFE where the step is `certain` to be, else with the probability that it is.
    static Flags joint(const double* rows, int count, int fluents, bool certain, double* out) {
        const int row = fluents + 3;
        const double* likeliest = rows;
        double reward = 0.0, risk = 0.0;
        for (const double* of = rows; of != rows + count * row; of += row) {
            const auto flags = static_cast<Flags>(of[fluents + 1]);
            const double probability = of[fluents + 2];
            if (probability > likeliest[fluents + 2] * (1.0 + 1e-9)) likeliest = of;  // not by rounding
            reward += probability * of[fluents];
            risk += probability * (flags & UNSAFE ? 1.0 : risk_units(flags) * RISK_UNIT);
        }
        std::copy_n(likeliest, fluents, out);
        out[fluents] = reward;
        const auto flags = static_cast<Flags>(likeliest[fluents + 1]);
        const Flags bits = flags & (APPLICABLE | TERMINAL | END_MASK << END_SHIFT);
        return certain ? bits | UNSAFE : with_risk(bits, std::min(risk, 1.0));
    }

    /// Writes the step of an action as its only outcome, see `outcomes`; returns 1.
    int only_outcome(int action, double* rows, int fluents) {
        rows[fluents + 1] = static_cast<double>(step(action, rows));
        rows[fluents + 2] = 1.0;
        return 1;
    }

    /// Predicts the steps from one state, one by one.
    Steps each_step(const double* state, int actions, int fluents) {
        const int width = fluents + 1;
        flags_.resize(actions);
        numbers_.resize(static_cast<std::size_t>(actions) * width);
        from(state);
        for (int action = 0; action < actions; ++action)
            flags_[action] = step(action, numbers_.data() + std::ptrdiff_t{action} * width);
        return {1, 1, flags_.data(), numbers_.data(), 1, width};
    }

private:
    std::vector<Flags> flags_;
    std::vector<double> numbers_;
};

/// A transition model. What it has learned may change between decisions; steppers see the change.
class Model {
public:
    virtual ~Model() = default;

    virtual int fluents() const = 0;
    virtual int actions() const = 0;
    virtual std::unique_ptr<Stepper> stepper() const = 0;

    /// Returns whether a step may have several outcomes.
    virtual bool branches() const { return false; }
};

}  // namespace serp
