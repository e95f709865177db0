// The instruction table of a ground model, and the fast step that executes it.
#pragma once

#include <cstdint>
#include <vector>

#include "serp/model/flags.hpp"

namespace serp {

/// One instruction: what to do, and three operands. An operand is `memory << 24 | position`.
struct Instruction {
    std::int32_t code, a, b, c;
};

/// Where the parts of a step begin in the table. Each ends with an instruction that returns.
struct Entries {
    std::vector<std::int32_t> action;         ///< [A] the effects of each action
    std::vector<std::int32_t> judged_action;  ///< [A] what of them concerns reward and flags
    std::int32_t drift = 0;                   ///< processes
    std::int32_t settle = 0;                  ///< events, goal, metric
    std::int32_t aftermath = 0;               ///< rewards of processes, then as `settle`, of an observed state
    std::int32_t goal = 0;                    ///< the goal alone
};

/// The compiled file, as written: a pure function of state, action, parameters and control period.
///
/// `registers` is scratch memory of `registers()` numbers. Arrays must not overlap.
class Program {
public:
    /// Throws std::invalid_argument where an operand, a jump or an entry leads outside, or where a
    /// part does not end with a return: what runs without checks is checked here.
    Program(std::vector<Instruction> code, std::vector<double> constants, Entries entries,
            int fluents, int parameters, int registers);

    int fluents() const { return fluents_; }
    int actions() const { return static_cast<int>(entries_.action.size()); }
    int parameters() const { return parameters_; }
    int registers() const { return registers_; }

    /// Effects of an action (-1: of none) and processes. Writes next state and reward to `out`
    /// [F + 1].
    Flags flow(const double* state, int action, const double* theta, double dt, double* out,
               double* registers) const;

    /// Events, goal and metric, applied to what `flow` wrote; `flags` are those that it returned.
    Flags settle(const double* state, Flags flags, const double* theta, double dt, double* out,
                 double* registers) const;

    /// `flow` and, where that is applicable, `settle`.
    Flags step(const double* state, int action, const double* theta, double dt, double* out,
               double* registers) const;

    /// Reward and flags of an observed transition; the reward is written to `out` [F + 1] at F.
    Flags judge(const double* state, int action, const double* next_state, const double* theta,
                double dt, double* out, double* registers) const;

    /// Whether the goal holds in a state.
    bool at_goal(const double* state, const double* theta, double dt, double* registers) const;

private:
    std::vector<Instruction> code_;
    std::vector<double> constants_;
    Entries entries_;
    int fluents_, parameters_, registers_;
};

}  // namespace serp
