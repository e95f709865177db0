// The instruction table of a ground model, and the fast step that executes it.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <vector>

#include "serp/model/model.hpp"

namespace serp {

/// One instruction: what to do, and three operands, which are positions in the frame.
struct Instruction {
    std::uint32_t code, a, b, c;
};

/// What an instruction does. The names a, b, c stand for the numbers at these positions of the
/// frame, but in jumps c is a position in the table. An operation without a result gives NaN.
enum class Code : std::uint32_t {
    RETURN,    ///< end; the flags are the bits `a`, and those of the bits `b` that are set
    COPY,      ///< out becomes the state, with a reward of 0
    CLEAR,     ///< the numbers from a to b become 0
    MOVE,      ///< a = b
    ADD,       ///< a = b + c; the following likewise
    SUBTRACT,
    MULTIPLY,
    DIVIDE,
    MIN,
    MAX,
    ATAN2,
    NEGATE,    ///< a = -b; the following likewise
    ABS,
    SQRT,
    SIN,
    COS,
    JUMP,      ///< go on at c, which lies further on
    JUMP_IF,   ///< jump where a is not 0
    JUMP_UNLESS,
    IF_LESS,   ///< jump where a < b; the following likewise
    IF_LESS_OR_EQUAL,
    IF_EQUAL,
    UNLESS_LESS,
    UNLESS_LESS_OR_EQUAL,
    UNLESS_EQUAL,
    UNLESS_FINITE,  ///< jump where a is NaN or infinite
    REPEAT,    ///< where a is not 0, go back to c; so often at most as there are instructions
    CODES
};

/// The parts of a step. Each ends with an instruction that returns.
enum Part : std::size_t {
    DRIFT,      ///< processes
    SETTLE,     ///< events, goal, metric
    AFTERMATH,  ///< rewards of processes, then as SETTLE, of an observed state
    ACTIONS     ///< [2(A + O)] preconditions and effects of actions, then of all their outcomes but
                ///< the likeliest; then what of these concerns reward and flags
};

/// Memory for steps that are executed together, one in each lane: those of all actions from S states,
/// a multiple of the lanes of a vector register. A row of the frame has a number of each lane.
struct Lanes {
    /// Fewer states do not pay.
    static constexpr int FEW = 4;

    int states = -1;  ///< S; -1: not prepared; 0: no action, or too large for a cache
    std::size_t count = 0;             ///< L = A * S
    std::vector<double> frame;         ///< [registers, L]
    std::vector<std::int64_t> resume;  ///< [L] where a lane goes on
    std::vector<Flags> flags;          ///< [L]
};

/// The compiled file, as written: a pure function of state, action, parameters and control period.
///
/// Arrays: `state` and `next_state` [F], `theta` [P], `out` [F + 1] with the reward at F.
///
/// Instructions work on the frame, scratch memory `registers` of `registers()` numbers: the control
/// period, UNSAFE and TERMINAL as numbers, the constants 0 to 3, then theta, next state, out, state,
/// and intermediate results. They write to UNSAFE, TERMINAL, out and intermediate results. Execution
/// always ends: all jumps but those of REPEAT lead further on, and REPEAT is bounded.
class Program {
public:
    /// `entries` [3 + 2(A + O)] are where the parts begin in the table, see `Part`; `intermediate`
    /// is the number of intermediate results; from `first_chance` [A + 1] on, `chances` [A + O] has
    /// the probabilities of the outcomes of each action, the likeliest first. Throws
    /// std::invalid_argument where an operand, a jump or an entry leads outside, or where the last
    /// instruction goes on: what runs without checks is checked here.
    Program(std::vector<Instruction> code, std::vector<std::uint32_t> entries, int fluents,
            int parameters, int intermediate, std::vector<std::uint32_t> first_chance,
            std::vector<double> chances);

    int fluents() const { return fluents_; }
    int actions() const { return static_cast<int>(first_chance_.size()) - 1; }
    /// Whether an action has several outcomes.
    bool branches() const { return chances_.size() > first_chance_.size() - 1; }
    /// The number of outcomes of an action; 1 for no action (-1).
    int outcomes(int action) const {
        return action < 0 ? 1 : static_cast<int>(first_chance_[action + 1] - first_chance_[action]);
    }
    /// The probability of an outcome, by its number from 0.
    double chance(int action, int outcome) const {
        return chances_[first_chance_[action] + outcome];
    }
    /// What `step`, `flow` and `judge` take in place of an action for one of its outcomes.
    int variant(int action, int outcome) const {
        if (outcome == 0) return action;
        return actions() + static_cast<int>(first_chance_[action]) - action + outcome - 1;
    }
    int parameters() const { return parameters_; }
    int registers() const { return intermediate_at_ + intermediate_; }

    // Many steps: `prepare` once, `from` for each state, then `step` for each action.

    /// Prepares scratch memory for parameters and a control period.
    void prepare(const double* theta, double dt, double* registers) const;
    /// Sets the state that steps start from.
    void from(const double* state, double* registers) const;
    /// `flow` and, where that is applicable, `settle`.
    Flags step(int action, double* out, double* registers) const;
    /// Effects of an action (-1: of none) and processes. Writes next state and reward to `out`,
    /// where that is applicable.
    Flags flow(int action, double* out, double* registers) const;
    /// Events, goal and metric, applied to what `flow` wrote; `flags` are those that it returned.
    Flags settle(Flags flags, double* out, double* registers) const;

    // `step` in lanes, for many states and actions at once. The same bits.

    /// Prepares lanes from scratch memory that is prepared.
    void prepare(const double* registers, Lanes& of) const;
    /// See `Stepper::steps`.
    Steps steps(const double* states, int count, Lanes& of) const;

    // One step of its own.

    /// Reward and flags of an observed transition: those of the step where it leads to exactly that
    /// state. The reward is written to `out` at F. Action -1 is none of the model's.
    Flags judge(const double* state, int action, const double* next_state, const double* theta,
                double dt, double* out, double* registers) const;

private:
    /// The number of actions and their further outcomes.
    int variants() const { return static_cast<int>(entries_.size() - ACTIONS) / 2; }
    Flags run(double* frame, std::initializer_list<std::uint32_t> parts) const;
    Flags finished(Flags flags, double* out, const double* frame) const;

    std::vector<Instruction> code_;
    std::vector<std::uint32_t> entries_, first_chance_;
    std::vector<double> chances_;
    int fluents_, parameters_, intermediate_;
    /// Where these numbers begin in the frame.
    int next_state_at_ = 0, out_at_ = 0, state_at_ = 0, intermediate_at_ = 0;
};

}  // namespace serp
