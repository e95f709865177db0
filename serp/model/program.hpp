// The instruction table of a ground model, and the fast step that executes it.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "serp/model/flags.hpp"

namespace serp {

/// One instruction: what to do, and three operands. An operand is `memory << 24 | position`.
struct Instruction {
    std::int32_t code, a, b, c;
};

/// What an operand refers to. Only registers and `OUT` are written.
enum Memory : std::int32_t { REGISTERS, STATE, OUT, THETA, CONSTANTS, NEXT_STATE, MEMORIES };

/// Registers with a meaning; the others are intermediate results.
enum Variable : std::int32_t { ELAPSED, UNSAFE_SET, TERMINAL_SET, VARIABLES };

/// What an instruction does. The names a, b, c stand for the numbers that the operands refer to,
/// and in jumps c is a position in the table. An operation without a result gives NaN.
enum class Code : std::int32_t {
    RETURN,       ///< end; the flags are the bits `a`, and those of the bits `b` that are set
    COPY,         ///< out becomes the state, with a reward of 0
    MOVE,         ///< a = b
    ADD,          ///< a = b + c; the following likewise
    SUBTRACT,
    MULTIPLY,
    DIVIDE,
    MIN,
    MAX,
    ATAN2,
    NEGATE,       ///< a = -b; the following likewise
    ABS,
    SQRT,
    SIN,
    COS,
    JUMP,         ///< go on at c, which lies further on
    JUMP_IF,      ///< jump where a is not 0
    JUMP_UNLESS,
    IF_LESS,      ///< jump where a < b; the following likewise
    IF_LESS_OR_EQUAL,
    IF_EQUAL,
    UNLESS_LESS,
    UNLESS_LESS_OR_EQUAL,
    UNLESS_EQUAL,
    UNLESS_FINITE,  ///< jump where a is NaN or infinite
    REPEAT,       ///< where a is not 0, go back to c; so often at most as there are instructions
    CODES
};

/// Where the parts of a step begin in the table. Each ends with an instruction that returns.
struct Entries {
    std::vector<std::int32_t> action;         ///< [A] preconditions and effects of each action
    std::vector<std::int32_t> judged_action;  ///< [A] what of them concerns reward and flags
    std::int32_t drift = 0;                   ///< processes
    std::int32_t settle = 0;                  ///< events, goal, metric
    std::int32_t aftermath = 0;  ///< rewards of processes, then as `settle`, of an observed state
    std::int32_t goal = 0;       ///< the goal alone
};

/// The compiled file, as written: a pure function of state, action, parameters and control period.
///
/// Arrays: `state` and `next_state` [F], `theta` [P], `out` [F + 1] with the reward at F. Scratch
/// memory `registers` has `registers()` numbers. Arrays must not overlap. Execution always ends: all
/// jumps but those of REPEAT lead further on, and REPEAT is bounded.
class Program {
public:
    /// Throws std::invalid_argument where an operand, a jump or an entry leads outside, or where the
    /// last instruction goes on: what runs without checks is checked here.
    Program(std::vector<Instruction> code, std::vector<double> constants, Entries entries,
            int fluents, int parameters, int registers);

    int fluents() const { return fluents_; }
    int actions() const { return static_cast<int>(entries_.action.size()); }
    int parameters() const { return parameters_; }
    int registers() const { return registers_; }
    const std::vector<Instruction>& code() const { return code_; }
    const std::vector<double>& constants() const { return constants_; }
    const Entries& entries() const { return entries_; }

    /// Effects of an action (-1: of none) and processes. Writes next state and reward to `out`.
    /// Where the precondition fails, `out` is not touched.
    Flags flow(const double* state, int action, const double* theta, double dt, double* out,
               double* registers) const;

    /// Events, goal and metric, applied to what `flow` wrote; `flags` are those that it returned.
    Flags settle(const double* state, Flags flags, const double* theta, double dt, double* out,
                 double* registers) const;

    /// `flow` and, where that is applicable, `settle`.
    Flags step(const double* state, int action, const double* theta, double dt, double* out,
               double* registers) const;

    /// Reward and flags of an observed transition; the reward is written to `out` at F. Action -1
    /// is none of the model's.
    Flags judge(const double* state, int action, const double* next_state, const double* theta,
                double dt, double* out, double* registers) const;

    /// Whether the goal holds in a state.
    bool at_goal(const double* state, const double* theta, double dt, double* registers) const;

private:
    using Memories = std::array<double*, MEMORIES>;

    Memories memories(const double* state, const double* theta, double dt, double* out,
                      double* registers, Flags flags) const;
    Flags run(const Memories& memory, std::int32_t entry) const;
    Flags flow(const Memories& memory, int action) const;

    std::vector<Instruction> code_;
    std::vector<double> constants_;
    Entries entries_;
    int fluents_, parameters_, registers_;
};

}  // namespace serp
