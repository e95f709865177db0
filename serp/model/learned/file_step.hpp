// The step of the file with the parameters in use, and observed ones, as the learned parts see them.
#pragma once

#include <cstddef>
#include <vector>

#include "serp/model/program.hpp"

namespace serp {

/// Which ground actions of other schemas have the same arguments.
struct SameArguments {
    int schemas = 0;
    std::vector<int> action;  ///< [A * S], -1 where there is none and for the action itself

    int actions() const { return schemas > 0 ? static_cast<int>(action.size()) / schemas : 0; }
    /// -1, too, for a schema that the model does not have: a table may have counted those of another.
    int of(int ground_action, std::int64_t schema) const {
        if (schema < 0 || schema >= schemas) return -1;
        return action[static_cast<std::size_t>(ground_action) * schemas + schema];
    }
};

/// Effects and processes, then events, with parameters of one time. Has scratch memory: one for each
/// thread. `from` comes before all else.
class FileStep {
public:
    FileStep(const Program& program, const double* theta, double dt, const SameArguments& others)
        : program_(&program), others_(&others), frame_(program.registers()) {
        program.prepare(theta, dt, frame_.data());
    }

    int width() const { return program_->fluents(); }
    const SameArguments& others() const { return *others_; }

    const Program& program() const { return *program_; }

    /// Sets the state [F] that steps start from, by a copy.
    void from(const double* state) { program_->from(state, frame_.data()); }

    /// Sets the outcome that `step` and `flow` predict from now on, where an action has several.
    void choose(int outcome) { outcome_ = outcome; }
    int chosen() const { return outcome_; }

    /// The whole step; see `Program::step`.
    Flags step(int action, double* out) {
        return program_->step(program_->variant(action, outcome_), out, frame_.data());
    }

    /// Writes state [F] and reward after effects and processes; see `Program::flow`.
    Flags flow(int action, double* out) {
        return program_->flow(program_->variant(action, outcome_), out, frame_.data());
    }

    /// `flow` with the likeliest outcome of an action, whatever was chosen.
    Flags usual_flow(int action, double* out) { return program_->flow(action, out, frame_.data()); }

    /// Applies events to what `flow` wrote; see `Program::settle`.
    Flags settle(Flags flags, double* out) { return program_->settle(flags, out, frame_.data()); }

private:
    const Program* program_;
    const SameArguments* others_;
    std::vector<double> frame_;
    int outcome_ = 0;
};

/// Numbers of at least this size are not learned from; sums of their squares would overflow.
inline constexpr double HUGE_NUMBER = 1e60;

/// An observed transition, beside what the file says of it.
struct ObservedStep {
    FileStep file;
    int action;
    bool over;                               ///< whether it ended the episode
    double reward;                           ///< NaN where it is not to be learned
    std::vector<double> state, next_state;   ///< [F]
    std::vector<double> flowed, settled{};   ///< [F + 1] after effects and processes; after events
    Flags flags = 0;                         ///< of `flowed`
    /// Reward and end as the model predicts them without its `worth`, and whether that is used here.
    double expected_reward = 0.0, expected_end = 0.0;
    bool weighed = false;

    /// Whether its numbers are small enough to learn from. After the end of an episode the next
    /// state need not be what the file says, so it does not matter then.
    bool usable() const;
};

}  // namespace serp
