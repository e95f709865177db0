// A model as planners see it.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "serp/model/flags.hpp"

namespace serp {

/// Most outcomes of one step, see `Stepper::outcomes`; callers make room for them.
inline constexpr int OUTCOMES = 16;
/// Uncertainty from which on nothing is known of a step: the data say less than the prior.
inline constexpr double UNKNOWN = 0.5;

/// Steps of consecutive actions from some states, see `Stepper::steps`. Action a, counted from the
/// first, from state k is in lane a * apart + k.
struct Steps {
    int states, actions, apart;
    const Flags* flags = nullptr;     ///< [lanes]
    const double* numbers = nullptr;  ///< next state [F] and reward
    std::ptrdiff_t row = 1, lane = 1; ///< from a number to the next one of a step; of the next step
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

    /// Predicts steps as `step` does, of all actions from `action` on, or some, from the first of
    /// `count` states, in rows of F + 1 numbers. Returns all actions where there is more than one
    /// state. Valid until the next call.
    virtual Steps steps(const double* states, int count, int action) = 0;

    /// Predicts all outcomes of an applicable action. Writes rows of F + 3 numbers: next state,
    /// reward, flags and probability. Returns how many there are, at most OUTCOMES.
    virtual int outcomes(int action, double* rows) = 0;

    /// Returns how far a step is from the data, in [0, 1]; 0 where the file alone predicts.
    virtual double uncertainty(int /*action*/) { return 0.0; }

protected:
    /// Writes the step of an action as its only outcome, see `outcomes`; returns 1.
    int only_outcome(int action, double* rows, int fluents) {
        rows[fluents + 1] = static_cast<double>(step(action, rows));
        rows[fluents + 2] = 1.0;
        return 1;
    }

    /// `steps`, one by one.
    Steps each_step(const double* state, int action, int actions, int fluents) {
        const int count = actions - action, width = fluents + 1;
        flags_.resize(count);
        numbers_.resize(static_cast<std::size_t>(count) * width);
        from(state);
        for (int k = 0; k < count; ++k)
            flags_[k] = step(action + k, numbers_.data() + static_cast<std::size_t>(k) * width);
        return {1, count, 1, flags_.data(), numbers_.data(), 1, width};
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
