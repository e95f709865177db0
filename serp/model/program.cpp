#include "serp/model/program.hpp"

#include "serp/model/model.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

namespace serp {

namespace {

constexpr double NOT_A_NUMBER = std::numeric_limits<double>::quiet_NaN();
/// The beginning of the frame. The constants 0 to 3 follow the flags.
enum Fixed : std::uint32_t { ELAPSED, UNSAFE_SET, TERMINAL_SET, CONSTANTS, THETA = CONSTANTS + 4 };

/// What the operands of each code are: w(ritten), r(ead), u(p to), j(ump), b(ack), f(lags), unused.
constexpr const char* OPERANDS[] = {
    "ff-", "---", "wu-", "wr-", "wrr", "wrr", "wrr", "wrr", "wrr",
    "wrr", "wrr", "wr-", "wr-", "wr-", "wr-", "wr-", "--j", "r-j",
    "r-j", "rrj", "rrj", "rrj", "rrj", "rrj", "rrj", "r-j", "r-b",
};
static_assert(std::size(OPERANDS) == static_cast<size_t>(Code::CODES));

[[noreturn]] void refuse(const std::string& what) {
    throw std::invalid_argument("the instruction table is damaged: " + what);
}

bool is_number(double value) { return value - value == 0.0; }

}  // namespace

Program::Program(std::vector<Instruction> code, std::vector<std::uint32_t> entries, int fluents,
                 int parameters, int intermediate, std::vector<std::uint32_t> first_chance,
                 std::vector<double> chances)
    : code_(std::move(code)),
      entries_(std::move(entries)),
      first_chance_(std::move(first_chance)),
      chances_(std::move(chances)),
      fluents_(fluents),
      parameters_(parameters),
      intermediate_(intermediate) {
    constexpr int MOST = 1 << 28;
    if (std::min({fluents, parameters, intermediate}) < 0 ||
        std::max({fluents, parameters, intermediate}) > MOST)
        refuse("the size of its frame");
    next_state_at_ = static_cast<int>(THETA) + parameters;
    out_at_ = next_state_at_ + fluents;
    state_at_ = out_at_ + fluents + 1;
    intermediate_at_ = state_at_ + fluents;
    if (code_.empty() || code_.size() > static_cast<size_t>(MOST))
        refuse("the number of instructions");

    const auto length = static_cast<std::uint32_t>(code_.size());
    const auto readable = [&](std::uint32_t operand) {
        return operand < static_cast<std::uint32_t>(registers());
    };
    const auto writable = [&](std::uint32_t operand) {
        const auto position = static_cast<std::int64_t>(operand);
        return readable(operand) &&
               (operand == UNSAFE_SET || operand == TERMINAL_SET || position >= intermediate_at_ ||
                (position >= out_at_ && position < state_at_));
    };
    for (std::uint32_t at = 0; at < length; ++at) {
        const Instruction& of = code_[at];
        const std::string place = " of instruction " + std::to_string(at);
        if (of.code >= static_cast<std::uint32_t>(Code::CODES)) refuse("the code" + place);
        const std::uint32_t operands[] = {of.a, of.b, of.c};
        for (int k = 0; k < 3; ++k) {
            const std::uint32_t operand = operands[k];
            bool valid = true;
            switch (OPERANDS[of.code][k]) {
                case 'f': valid = operand <= 0xFF; break;
                case 'j': valid = operand > at && operand < length; break;
                case 'b': valid = operand <= at; break;
                case 'r': valid = readable(operand); break;
                case 'w': valid = writable(operand); break;
                // From one intermediate result to another.
                case 'u':
                    valid = readable(operand) && operand >= of.a &&
                            static_cast<std::int64_t>(of.a) >= intermediate_at_;
                    break;
                default: break;
            }
            if (!valid) refuse("operand " + std::to_string(k + 1) + place);
        }
    }
    if (code_.back().code != static_cast<std::uint32_t>(Code::RETURN))
        refuse("the last instruction goes on");
    if (entries_.size() < ACTIONS || (entries_.size() - ACTIONS) % 2) refuse("the number of parts");
    for (const std::uint32_t entry : entries_)
        if (entry >= length) refuse("the start of a part");
    if (first_chance_.empty() || first_chance_.front() != 0 ||
        first_chance_.back() != chances_.size() ||
        chances_.size() != static_cast<size_t>(variants()))
        refuse("the number of outcomes");
    for (size_t action = 0; action + 1 < first_chance_.size(); ++action) {
        if (first_chance_[action + 1] <= first_chance_[action] ||
            first_chance_[action + 1] - first_chance_[action] > OUTCOMES ||
            first_chance_[action + 1] > chances_.size())
            refuse("the outcomes of an action");
        for (std::uint32_t k = first_chance_[action]; k < first_chance_[action + 1]; ++k)
            if (!(chances_[k] > 0.0 && chances_[k] <= 1.0)) refuse("the chance of an outcome");
    }
}

/// Executes parts one after another, as long as they are applicable; returns the flags.
Flags Program::run(double* frame, std::initializer_list<std::uint32_t> parts) const {
    const Instruction* const code = code_.data();
    const std::uint32_t* part = parts.begin();
    const Instruction* at = code + *part++;
    size_t repeats = code_.size();
    for (;;) {
        const Instruction& now = *at++;
        // The mask spares the compiler a check of the range.
        static_assert(static_cast<std::uint32_t>(Code::CODES) <= 32);
        switch (static_cast<Code>(now.code & 31)) {
            case Code::RETURN: {
                if ((now.a & APPLICABLE) && part != parts.end()) {
                    at = code + *part++;
                    break;
                }
                Flags flags = 0;
                if (frame[UNSAFE_SET] != 0.0) flags |= UNSAFE;
                if (frame[TERMINAL_SET] != 0.0) flags |= TERMINAL;
                return now.a | (flags & now.b);
            }
            case Code::COPY:
                std::copy_n(frame + state_at_, fluents_, frame + out_at_);
                frame[state_at_ - 1] = 0.0;
                break;
            case Code::CLEAR: std::fill(frame + now.a, frame + now.b + 1, 0.0); break;
            case Code::MOVE: frame[now.a] = frame[now.b]; break;
            case Code::ADD: frame[now.a] = frame[now.b] + frame[now.c]; break;
            case Code::SUBTRACT: frame[now.a] = frame[now.b] - frame[now.c]; break;
            case Code::MULTIPLY: frame[now.a] = frame[now.b] * frame[now.c]; break;
            case Code::DIVIDE: {
                const double divisor = frame[now.c];
                frame[now.a] = divisor != 0.0 ? frame[now.b] / divisor : NOT_A_NUMBER;
                break;
            }
            case Code::MIN: {
                const double one = frame[now.b], other = frame[now.c];
                frame[now.a] = one < other || one != one ? one : other;
                break;
            }
            case Code::MAX: {
                const double one = frame[now.b], other = frame[now.c];
                frame[now.a] = one > other || one != one ? one : other;
                break;
            }
            case Code::ATAN2: frame[now.a] = std::atan2(frame[now.b], frame[now.c]); break;
            case Code::NEGATE: frame[now.a] = -frame[now.b]; break;
            case Code::ABS: {
                const double operand = frame[now.b];
                frame[now.a] = operand > 0.0 ? operand : 0.0 - operand;
                break;
            }
            case Code::SQRT: {
                const double operand = frame[now.b];
                frame[now.a] = operand >= 0.0 ? std::sqrt(operand) : NOT_A_NUMBER;
                break;
            }
            case Code::SIN: {
                const double operand = frame[now.b];
                frame[now.a] = is_number(operand) ? std::sin(operand) : NOT_A_NUMBER;
                break;
            }
            case Code::COS: {
                const double operand = frame[now.b];
                frame[now.a] = is_number(operand) ? std::cos(operand) : NOT_A_NUMBER;
                break;
            }
            case Code::JUMP: at = code + now.c; break;
            case Code::JUMP_IF:
                if (frame[now.a] != 0.0) at = code + now.c;
                break;
            case Code::JUMP_UNLESS:
                if (frame[now.a] == 0.0) at = code + now.c;
                break;
            case Code::IF_LESS:
                if (frame[now.a] < frame[now.b]) at = code + now.c;
                break;
            case Code::IF_LESS_OR_EQUAL:
                if (frame[now.a] <= frame[now.b]) at = code + now.c;
                break;
            case Code::IF_EQUAL:
                if (frame[now.a] == frame[now.b]) at = code + now.c;
                break;
            case Code::UNLESS_LESS:
                if (!(frame[now.a] < frame[now.b])) at = code + now.c;
                break;
            case Code::UNLESS_LESS_OR_EQUAL:
                if (!(frame[now.a] <= frame[now.b])) at = code + now.c;
                break;
            case Code::UNLESS_EQUAL:
                if (!(frame[now.a] == frame[now.b])) at = code + now.c;
                break;
            case Code::UNLESS_FINITE:
                if (!is_number(frame[now.a])) at = code + now.c;
                break;
            case Code::REPEAT:
                if (frame[now.a] != 0.0 && repeats > 0) {
                    --repeats;
                    at = code + now.c;
                }
                break;
            case Code::CODES: return UNDEFINED;
        }
    }
}

void Program::prepare(const double* theta, double dt, double* registers) const {
    registers[ELAPSED] = dt;
    for (std::uint32_t k = 0; CONSTANTS + k < THETA; ++k) registers[CONSTANTS + k] = k;
    std::copy_n(theta, parameters_, registers + THETA);
}

void Program::from(const double* state, double* registers) const {
    std::copy_n(state, fluents_, registers + state_at_);
}

Flags Program::finished(Flags flags, double* out, const double* frame) const {
    if (flags & APPLICABLE) std::copy_n(frame + out_at_, fluents_ + 1, out);
    return flags;
}

Flags Program::step(int action, double* out, double* registers) const {
    registers[UNSAFE_SET] = registers[TERMINAL_SET] = 0.0;
    if (action >= 0)
        return finished(
            run(registers, {entries_[ACTIONS + action], entries_[DRIFT], entries_[SETTLE]}), out,
            registers);
    const Flags flags = flow(action, out, registers);
    return flags & APPLICABLE ? settle(flags, out, registers) : flags;
}

Flags Program::flow(int action, double* out, double* registers) const {
    registers[UNSAFE_SET] = registers[TERMINAL_SET] = 0.0;
    if (action >= 0)
        return finished(run(registers, {entries_[ACTIONS + action], entries_[DRIFT]}), out,
                        registers);
    std::copy_n(registers + state_at_, fluents_, registers + out_at_);
    registers[out_at_ + fluents_] = 0.0;
    return finished(run(registers, {entries_[DRIFT]}), out, registers);
}

Flags Program::settle(Flags flags, double* out, double* registers) const {
    registers[UNSAFE_SET] = flags & UNSAFE ? 1.0 : 0.0;
    registers[TERMINAL_SET] = flags & TERMINAL ? 1.0 : 0.0;
    std::copy_n(out, fluents_ + 1, registers + out_at_);
    return finished(run(registers, {entries_[SETTLE]}), out, registers);
}

Flags Program::judge(const double* state, int action, const double* next_state, const double* theta,
                     double dt, double* out, double* registers) const {
    prepare(theta, dt, registers);
    from(state, registers);
    registers[UNSAFE_SET] = registers[TERMINAL_SET] = 0.0;
    std::copy_n(next_state, fluents_, registers + next_state_at_);
    std::copy_n(next_state, fluents_, registers + out_at_);
    registers[out_at_ + fluents_] = 0.0;
    const Flags flags =
        action >= 0
            ? run(registers, {entries_[ACTIONS + variants() + action], entries_[AFTERMATH]})
            : run(registers, {entries_[AFTERMATH]});
    return finished(flags, out, registers);
}

}  // namespace serp
