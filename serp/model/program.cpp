#include "serp/model/program.hpp"

#include "serp/model/model.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "serp/_util/vector_code.hpp"

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
        double total = 0.0;
        for (std::uint32_t k = first_chance_[action]; k < first_chance_[action + 1]; ++k) {
            if (!(chances_[k] > 0.0 && chances_[k] <= 1.0)) refuse("the chance of an outcome");
            total += chances_[k];
        }
        if (std::abs(total - 1.0) > 1e-6) refuse("the chances of an action");
    }
}

namespace {

/// Lanes of a group: as many as the widest registers take.
constexpr int GROUP = 8;
/// Where a lane goes on whose part is over.
constexpr std::int64_t NOWHERE = std::numeric_limits<std::int64_t>::max();

/// Executes a part: for the lanes of some groups, or (not MANY) in a frame of one lane.
///
/// Lanes share the place in the table. As all jumps but those of REPEAT lead further on, a lane that
/// jumps where others do not has only to wait until these get there: it is active where its place in
/// `resume` has been reached (masks as in Fung et al., "Dynamic Warp Formation", MICRO 2007).
template <bool MANY>
struct Machine {
    const Instruction* const code;
    double* const frame;
    const int fluents;
    const std::size_t out_at;
    // Of many lanes: their number in the frame, the lanes of this part, and its results.
    const std::size_t lanes = 1, begin = 0, size = 1;
    std::int64_t* const resume = nullptr;  ///< as `flags`, it begins with the first of these
    Flags* flags = nullptr;

    const Instruction* at = nullptr;
    /// From this place on all lanes are active.
    std::int64_t together = 0;

    SERP_INLINE double* row(std::size_t place) const { return frame + place * lanes + begin; }
    SERP_INLINE std::int64_t here() const { return at - code - 1; }
    SERP_INLINE bool all_active() const { return !MANY || together <= here(); }

    /// Calls a function with each lane; it must not read what it wrote for other lanes.
    template <class Function>
    SERP_INLINE void each(Function function) const {
        const std::size_t count = MANY ? size / GROUP * GROUP : 1;
        SERP_INDEPENDENT
        for (std::size_t k = 0; k < count; ++k) function(k);
    }

    /// Sets a row to the values of a function of lanes, where these are active.
    template <class Value>
    SERP_INLINE void set(std::size_t place, Value value) {
        double* const target = row(place);
        if (all_active()) {
            each([=](std::size_t k) { target[k] = value(k); });
        } else {
            const std::int64_t now = here(), *const places = resume;
            each([=](std::size_t k) {
                const double number = value(k);
                target[k] = places[k] <= now ? number : target[k];
            });
        }
    }

    template <class Function>
    SERP_INLINE void unary(const Instruction& now, Function function) {
        const double* const b = row(now.b);
        set(now.a, [=](std::size_t k) { return function(b[k]); });
    }

    template <class Function>
    SERP_INLINE void binary(const Instruction& now, Function function) {
        const double *const b = row(now.b), *const c = row(now.c);
        set(now.a, [=](std::size_t k) { return function(b[k], c[k]); });
    }

    /// Returns in how many active lanes a test holds.
    template <class Test>
    SERP_INLINE std::int64_t count(Test test) const {
        std::int64_t sum = 0;
        if (all_active()) {
            each([&](std::size_t k) { sum += test(k) ? 1 : 0; });
        } else {
            const std::int64_t now = here(), *const places = resume;
            each([&](std::size_t k) { sum += (places[k] <= now) & test(k) ? 1 : 0; });
        }
        return sum;
    }

    /// Lets the active lanes go on where a function says.
    template <class Place>
    SERP_INLINE void go_on(Place place) {
        const std::int64_t now = here();
        std::int64_t* const places = resume;
        each([=](std::size_t k) { places[k] = places[k] <= now ? place(k) : places[k]; });
    }

    /// Returns the first place where a lane goes on.
    SERP_INLINE std::int64_t first_place() const {
        std::int64_t first = NOWHERE;
        const std::int64_t* const places = resume;
        each([&](std::size_t k) { first = places[k] < first ? places[k] : first; });
        return first;
    }

    template <class Test>
    SERP_INLINE void jump(const Instruction& now, Test test) {
        const std::int64_t jumping = count(test), next = here() + 1, there = now.c;
        if (jumping == static_cast<std::int64_t>(size)) {
            at = code + there;
        } else if (MANY && jumping > 0) {
            go_on([=](std::size_t k) { return test(k) ? there : next; });
            together = std::max(together, there);
            at = code + std::max(next, first_place());
        }
    }

    template <class Test>
    SERP_INLINE void jump_where(const Instruction& now, Test test) {
        const double* const a = row(now.a);
        jump(now, [=](std::size_t k) { return test(a[k]); });
    }

    template <class Test>
    SERP_INLINE void compare(const Instruction& now, Test test) {
        const double *const a = row(now.a), *const b = row(now.b);
        jump(now, [=](std::size_t k) { return test(a[k], b[k]); });
    }

    /// Ends the part for the active lanes; returns whether it is over for all.
    SERP_INLINE bool finish(const Instruction& of) {
        const Flags always = of.a, unsafe = of.b & UNSAFE, terminal = of.b & TERMINAL;
        const double *const u = row(UNSAFE_SET), *const t = row(TERMINAL_SET);
        const std::int64_t now = here(), *const places = resume;
        Flags* const results = flags;
        each([=](std::size_t k) {
            const Flags its =
                always | (u[k] != 0.0 ? unsafe : 0) | (t[k] != 0.0 ? terminal : 0);
            results[k] = !MANY || places[k] <= now ? its : results[k];
        });
        if (all_active()) return true;
        go_on([](std::size_t) { return NOWHERE; });
        if (always & APPLICABLE) together = NOWHERE;  // what these lanes wrote is still needed
        const std::int64_t first = first_place();
        if (first != NOWHERE) at = code + first;
        return first == NOWHERE;
    }

    SERP_INLINE void run(const Instruction* part, std::size_t repeats);
};

template <bool MANY>
SERP_INLINE void Machine<MANY>::run(const Instruction* part, std::size_t repeats) {
    const auto zero = [](std::size_t) { return 0.0; };
    at = part;
    for (;;) {
        const Instruction& now = *at++;
        // The mask spares the compiler a check of the range.
        static_assert(static_cast<std::uint32_t>(Code::CODES) <= 32);
        switch (static_cast<Code>(now.code & 31)) {
            case Code::RETURN:
                if (finish(now)) return;
                break;
            case Code::COPY:
                for (int f = 0; f < fluents; ++f) {
                    const double* const state = row(out_at + fluents + 1 + f);
                    set(out_at + f, [=](std::size_t k) { return state[k]; });
                }
                set(out_at + fluents, zero);
                break;
            case Code::CLEAR:
                for (std::size_t of = now.a; of <= now.b; ++of) set(of, zero);
                break;
            case Code::MOVE: unary(now, [](double b) { return b; }); break;
            case Code::ADD: binary(now, [](double b, double c) { return b + c; }); break;
            case Code::SUBTRACT: binary(now, [](double b, double c) { return b - c; }); break;
            case Code::MULTIPLY: binary(now, [](double b, double c) { return b * c; }); break;
            case Code::DIVIDE:
                binary(now, [](double b, double c) {
                    const double quotient = b / c;
                    return c != 0.0 ? quotient : NOT_A_NUMBER;
                });
                break;
            case Code::MIN:
                binary(now, [](double b, double c) { return b < c || b != b ? b : c; });
                break;
            case Code::MAX:
                binary(now, [](double b, double c) { return b > c || b != b ? b : c; });
                break;
            case Code::ATAN2:
                binary(now, [](double b, double c) { return std::atan2(b, c); });
                break;
            case Code::NEGATE: unary(now, [](double b) { return -b; }); break;
            case Code::ABS: unary(now, [](double b) { return b > 0.0 ? b : 0.0 - b; }); break;
            case Code::SQRT:
                unary(now, [](double b) { return b >= 0.0 ? std::sqrt(b) : NOT_A_NUMBER; });
                break;
            case Code::SIN:
                unary(now, [](double b) { return is_number(b) ? std::sin(b) : NOT_A_NUMBER; });
                break;
            case Code::COS:
                unary(now, [](double b) { return is_number(b) ? std::cos(b) : NOT_A_NUMBER; });
                break;
            case Code::JUMP: jump(now, [](std::size_t) { return true; }); break;
            case Code::JUMP_IF: jump_where(now, [](double a) { return a != 0.0; }); break;
            case Code::JUMP_UNLESS: jump_where(now, [](double a) { return a == 0.0; }); break;
            case Code::UNLESS_FINITE:
                jump_where(now, [](double a) { return !is_number(a); });
                break;
            case Code::IF_LESS: compare(now, [](double a, double b) { return a < b; }); break;
            case Code::IF_LESS_OR_EQUAL: compare(now, [](double a, double b) { return a <= b; }); break;
            case Code::IF_EQUAL: compare(now, [](double a, double b) { return a == b; }); break;
            case Code::UNLESS_LESS: compare(now, [](double a, double b) { return !(a < b); }); break;
            case Code::UNLESS_LESS_OR_EQUAL:
                compare(now, [](double a, double b) { return !(a <= b); });
                break;
            case Code::UNLESS_EQUAL: compare(now, [](double a, double b) { return !(a == b); }); break;
            case Code::REPEAT: {
                const double* const a = row(now.a);
                const auto again = [=](std::size_t k) { return a[k] != 0.0; };
                if (repeats == 0 || count(again) == 0) break;
                if constexpr (MANY) {
                    const std::int64_t next = here() + 1, back = now.c;
                    go_on([=](std::size_t k) { return again(k) ? back : next; });
                    together = std::max(together, next);
                }
                --repeats;
                at = code + now.c;
                break;
            }
            case Code::CODES: return;
        }
    }
}

/// Executes a part for `size` lanes, whole groups, as far as their flags are APPLICABLE.
SERP_VECTOR_CODE
void run_lanes(const Instruction* code, std::size_t length, std::uint32_t part, int fluents,
               int out_at, Lanes& of, std::size_t begin, std::size_t size) {
    std::int64_t* const resume = of.resume.data() + begin;
    Flags* const flags = of.flags.data() + begin;
    Machine<true> machine{code, of.frame.data(), fluents, static_cast<std::size_t>(out_at),
                          of.count, begin, size, resume, flags};
    machine.each([=](std::size_t k) { resume[k] = flags[k] & APPLICABLE ? 0 : NOWHERE; });
    machine.at = code + 1;
    const auto active = machine.count([=](std::size_t k) { return resume[k] == 0; });
    if (active < static_cast<std::int64_t>(size)) machine.together = NOWHERE;
    if (active > 0) machine.run(code + part, length);
}

}  // namespace

/// Executes parts one after another, as long as they are applicable; returns the flags.
Flags Program::run(double* frame, std::initializer_list<std::uint32_t> parts) const {
    Flags flags = APPLICABLE;
    for (const std::uint32_t part : parts) {
        if (!(flags & APPLICABLE)) break;
        Machine<false> machine{code_.data(), frame, fluents_, static_cast<std::size_t>(out_at_)};
        machine.flags = &flags;
        machine.run(code_.data() + part, code_.size());
    }
    return flags;
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

void Program::prepare(const double* registers, Lanes& of) const {
    constexpr std::size_t NEAR = 1 << 16, FAR = 1 << 19;  // bytes of the first and second cache
    const std::size_t size = sizeof(double) * this->registers() * GROUP * actions();
    of.states = 0;
    if (size == 0 || size > FAR) return;
    const int states = static_cast<int>(std::max<std::size_t>(1, NEAR / size)) * GROUP;
    of.count = static_cast<std::size_t>(states) * actions();
    of.resume.resize(of.count), of.flags.resize(of.count);
    of.frame.clear();
    for (int place = 0; place < this->registers(); ++place)
        of.frame.insert(of.frame.end(), of.count, registers[place]);
    of.states = states;  // now there is room for them
}

Steps Program::steps(const double* states, int count, Lanes& of) const {
    const std::size_t stride = static_cast<std::size_t>(fluents_) + 1;
    const int some = std::min(count, of.states), apart = (some + GROUP - 1) / GROUP * GROUP;
    const int lanes = apart * actions();
    const auto row = [&](int place) { return of.frame.data() + place * of.count; };
    std::fill_n(row(UNSAFE_SET), lanes, 0.0), std::fill_n(row(TERMINAL_SET), lanes, 0.0);
    std::fill_n(of.flags.data(), lanes, APPLICABLE);
    for (int f = 0; f < fluents_; ++f) {
        double* const its = row(state_at_ + f);
        // Lanes that are left of a group repeat the last state.
        for (int k = 0; k < apart; ++k) its[k] = states[std::min(k, some - 1) * stride + f];
        for (int begin = apart; begin < lanes; begin += apart) std::copy_n(its, apart, its + begin);
    }
    const auto run = [&](std::uint32_t part, int begin, int size) {
        run_lanes(code_.data(), code_.size(), part, fluents_, out_at_, of, begin, size);
    };
    for (int action = 0; action < actions(); ++action)
        run(entries_[ACTIONS + action], action * apart, apart);
    run(entries_[DRIFT], 0, lanes);
    run(entries_[SETTLE], 0, lanes);
    return {some, apart, of.flags.data(), row(out_at_), static_cast<std::ptrdiff_t>(of.count), 1};
}

Flags Program::judge(const double* state, int action, const double* next_state, const double* theta,
                     double dt, double* out, double* registers) const {
    prepare(theta, dt, registers);
    from(state, registers);
    const Flags predicted = step(action, out, registers);
    if (predicted & APPLICABLE && std::equal(out, out + fluents_, next_state)) return predicted;
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
