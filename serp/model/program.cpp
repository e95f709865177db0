#include "serp/model/program.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

namespace serp {

namespace {

constexpr int SHIFT = 24;
constexpr std::int32_t POSITION = (1 << SHIFT) - 1;
constexpr double NOT_A_NUMBER = std::numeric_limits<double>::quiet_NaN();

/// What the operands of each code are: w(ritten), r(ead), j(ump), back (b), flags (f), unused (-).
constexpr const char* OPERANDS[] = {
    "ff-", "---", "wr-", "wrr", "wrr", "wrr", "wrr", "wrr", "wrr", "wrr", "wr-", "wr-", "wr-",
    "wr-", "wr-", "--j", "r-j", "r-j", "rrj", "rrj", "rrj", "rrj", "rrj", "rrj", "r-j", "r-b",
};
static_assert(std::size(OPERANDS) == static_cast<size_t>(Code::CODES));

[[noreturn]] void refuse(const std::string& what) {
    throw std::invalid_argument("an instruction table is damaged: " + what);
}

bool is_number(double value) { return value - value == 0.0; }

}  // namespace

Program::Program(std::vector<Instruction> code, std::vector<double> constants, Entries entries,
                 int fluents, int parameters, int registers)
    : code_(std::move(code)),
      constants_(std::move(constants)),
      entries_(std::move(entries)),
      fluents_(fluents),
      parameters_(parameters),
      // `at_goal` has no `out`: a table that writes there all the same writes to the registers.
      registers_(std::max(registers, fluents + 1)) {
    if (fluents < 0 || fluents >= POSITION || parameters < 0 || registers < VARIABLES ||
        registers > POSITION)
        refuse("the number of fluents, parameters or registers");
    if (code_.empty() || code_.size() > static_cast<size_t>(std::numeric_limits<std::int32_t>::max()))
        refuse("the number of instructions");
    const auto length = static_cast<std::int32_t>(code_.size());
    const std::int64_t sizes[MEMORIES] = {registers_, fluents_, fluents_ + 1, parameters_,
                                          static_cast<std::int64_t>(constants_.size()), fluents_};
    for (std::int32_t at = 0; at < length; ++at) {
        const Instruction& of = code_[at];
        const std::string place = " of instruction " + std::to_string(at);
        if (of.code < 0 || of.code >= static_cast<std::int32_t>(Code::CODES)) refuse("the code" + place);
        const std::int32_t operands[] = {of.a, of.b, of.c};
        for (int k = 0; k < 3; ++k) {
            const char kind = OPERANDS[of.code][k];
            const std::int32_t operand = operands[k], memory = operand >> SHIFT;
            bool valid = true;
            if (kind == 'f') valid = operand >= 0 && operand <= 0xFF;
            if (kind == 'j') valid = operand > at && operand < length;
            if (kind == 'b') valid = operand >= 0 && operand <= at;
            if (kind == 'r' || kind == 'w')
                valid = memory >= 0 && memory < MEMORIES && (operand & POSITION) < sizes[memory];
            if (kind == 'w') valid = valid && (memory == REGISTERS || memory == OUT);
            if (!valid) refuse("operand " + std::to_string(k + 1) + place);
        }
    }
    const auto last = static_cast<Code>(code_.back().code);
    if (last != Code::RETURN) refuse("the last instruction goes on");
    const auto inside = [&](std::int32_t entry) { return entry >= 0 && entry < length; };
    if (entries_.action.size() != entries_.judged_action.size() ||
        !std::all_of(entries_.action.begin(), entries_.action.end(), inside) ||
        !std::all_of(entries_.judged_action.begin(), entries_.judged_action.end(), inside) ||
        !inside(entries_.drift) || !inside(entries_.settle) || !inside(entries_.aftermath) ||
        !inside(entries_.goal))
        refuse("the start of a part");
}

Program::Memories Program::memories(const double* state, const double* theta, double dt,
                                    double* out, double* registers, Flags flags) const {
    registers[ELAPSED] = dt;
    registers[UNSAFE_SET] = flags & UNSAFE ? 1.0 : 0.0;
    registers[TERMINAL_SET] = flags & TERMINAL ? 1.0 : 0.0;
    // The constructor has checked that only registers and `out` are written.
    auto* read = const_cast<double*>(state);
    return {registers, read, out, const_cast<double*>(theta),
            const_cast<double*>(constants_.data()), read};
}

Flags Program::run(const Memories& memory, std::int32_t entry) const {
    const Instruction* const code = code_.data();
    const Instruction* at = code + entry;
    size_t repeats = code_.size();
    const auto of = [&memory](std::int32_t operand) -> double& {
        return memory[static_cast<std::uint32_t>(operand) >> SHIFT][operand & POSITION];
    };
    for (;;) {
        const Instruction& now = *at++;
        switch (static_cast<Code>(now.code)) {
            case Code::RETURN: {
                const double* registers = memory[REGISTERS];
                Flags flags = 0;
                if (registers[UNSAFE_SET] != 0.0) flags |= UNSAFE;
                if (registers[TERMINAL_SET] != 0.0) flags |= TERMINAL;
                return now.a | (flags & now.b);
            }
            case Code::COPY:
                std::copy_n(memory[STATE], fluents_, memory[OUT]);
                memory[OUT][fluents_] = 0.0;
                break;
            case Code::MOVE: of(now.a) = of(now.b); break;
            case Code::ADD: of(now.a) = of(now.b) + of(now.c); break;
            case Code::SUBTRACT: of(now.a) = of(now.b) - of(now.c); break;
            case Code::MULTIPLY: of(now.a) = of(now.b) * of(now.c); break;
            case Code::DIVIDE: {
                const double divisor = of(now.c);
                of(now.a) = divisor != 0.0 ? of(now.b) / divisor : NOT_A_NUMBER;
                break;
            }
            case Code::MIN: {
                const double one = of(now.b), other = of(now.c);
                of(now.a) = one < other || one != one ? one : other;
                break;
            }
            case Code::MAX: {
                const double one = of(now.b), other = of(now.c);
                of(now.a) = one > other || one != one ? one : other;
                break;
            }
            case Code::ATAN2: of(now.a) = std::atan2(of(now.b), of(now.c)); break;
            case Code::NEGATE: of(now.a) = -of(now.b); break;
            case Code::ABS: {
                const double operand = of(now.b);
                of(now.a) = operand > 0.0 ? operand : 0.0 - operand;
                break;
            }
            case Code::SQRT: {
                const double operand = of(now.b);
                of(now.a) = operand >= 0.0 ? std::sqrt(operand) : NOT_A_NUMBER;
                break;
            }
            case Code::SIN: {
                const double operand = of(now.b);
                of(now.a) = is_number(operand) ? std::sin(operand) : NOT_A_NUMBER;
                break;
            }
            case Code::COS: {
                const double operand = of(now.b);
                of(now.a) = is_number(operand) ? std::cos(operand) : NOT_A_NUMBER;
                break;
            }
            case Code::JUMP: at = code + now.c; break;
            case Code::JUMP_IF:
                if (of(now.a) != 0.0) at = code + now.c;
                break;
            case Code::JUMP_UNLESS:
                if (of(now.a) == 0.0) at = code + now.c;
                break;
            case Code::IF_LESS:
                if (of(now.a) < of(now.b)) at = code + now.c;
                break;
            case Code::IF_LESS_OR_EQUAL:
                if (of(now.a) <= of(now.b)) at = code + now.c;
                break;
            case Code::IF_EQUAL:
                if (of(now.a) == of(now.b)) at = code + now.c;
                break;
            case Code::UNLESS_LESS:
                if (!(of(now.a) < of(now.b))) at = code + now.c;
                break;
            case Code::UNLESS_LESS_OR_EQUAL:
                if (!(of(now.a) <= of(now.b))) at = code + now.c;
                break;
            case Code::UNLESS_EQUAL:
                if (!(of(now.a) == of(now.b))) at = code + now.c;
                break;
            case Code::UNLESS_FINITE:
                if (!is_number(of(now.a))) at = code + now.c;
                break;
            case Code::REPEAT:
                if (of(now.a) != 0.0 && repeats > 0) {
                    --repeats;
                    at = code + now.c;
                }
                break;
            case Code::CODES: return UNDEFINED;
        }
    }
}

Flags Program::flow(const Memories& memory, int action) const {
    Flags flags = APPLICABLE;
    if (action >= 0) {
        flags = run(memory, entries_.action[action]);
    } else {
        std::copy_n(memory[STATE], fluents_, memory[OUT]);
        memory[OUT][fluents_] = 0.0;
    }
    return flags & APPLICABLE ? run(memory, entries_.drift) : flags;
}

Flags Program::flow(const double* state, int action, const double* theta, double dt, double* out,
                    double* registers) const {
    return flow(memories(state, theta, dt, out, registers, 0), action);
}

Flags Program::settle(const double* state, Flags flags, const double* theta, double dt,
                      double* out, double* registers) const {
    return run(memories(state, theta, dt, out, registers, flags), entries_.settle);
}

Flags Program::step(const double* state, int action, const double* theta, double dt, double* out,
                    double* registers) const {
    const Memories memory = memories(state, theta, dt, out, registers, 0);
    const Flags flags = flow(memory, action);
    return flags & APPLICABLE ? run(memory, entries_.settle) : flags;
}

Flags Program::judge(const double* state, int action, const double* next_state, const double* theta,
                     double dt, double* out, double* registers) const {
    Memories memory = memories(state, theta, dt, out, registers, 0);
    memory[NEXT_STATE] = const_cast<double*>(next_state);
    std::copy_n(next_state, fluents_, out);
    out[fluents_] = 0.0;
    Flags flags = APPLICABLE;
    if (action >= 0) flags = run(memory, entries_.judged_action[action]);
    return flags & APPLICABLE ? run(memory, entries_.aftermath) : flags;
}

bool Program::at_goal(const double* state, const double* theta, double dt,
                      double* registers) const {
    const Memories memory = memories(state, theta, dt, registers, registers, 0);
    return run(memory, entries_.goal) & TERMINAL;
}

}  // namespace serp
