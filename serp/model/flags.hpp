// The flags of a predicted step; the counterpart of flags.py, which documents them.
#pragma once

#include <cstdint>

namespace serp {

using Flags = std::int64_t;

inline constexpr Flags APPLICABLE = 1, UNSAFE = 2, TERMINAL = 4, UNDEFINED = 8, RISKY = 16;
inline constexpr int RISK_SHIFT = 8;
inline constexpr double RISK_UNIT = 1.0 / (1 << 24);
inline constexpr Flags RISK_MASK = (1 << 25) - 1, END_MASK = (1 << 16) - 1;
inline constexpr int END_SHIFT = 34;

/// Returns the risk in flags, in units of RISK_UNIT.
inline Flags risk_units(Flags flags) { return (flags >> RISK_SHIFT) & RISK_MASK; }

/// Adds a risk in [0, 1], rounded to a multiple of 2^-24, to flags without one.
inline Flags with_risk(Flags flags, double risk) {
    return flags | (static_cast<Flags>(risk / RISK_UNIT + 0.5) << RISK_SHIFT);
}

/// Adds the learned chance in [0, 1] that the task ends with a step, to flags without one.
inline Flags with_end(Flags flags, double chance) {
    return flags | (static_cast<Flags>(chance * END_MASK + 0.5) << END_SHIFT);
}

/// Returns the probability that the task goes on after a step that is not TERMINAL.
inline double going_on(Flags flags) {
    return 1.0 - static_cast<double>((flags >> END_SHIFT) & END_MASK) / END_MASK;
}

/// Returns the flags of two consecutive steps, without ends: the bits of both, and their joint risk.
inline Flags joined(Flags flags, Flags further) {
    Flags bits = (flags | further) & 0xFF;
    const Flags first = risk_units(flags), second = risk_units(further);
    if (first | second) {
        const double safe = (1.0 - first * RISK_UNIT) * (1.0 - second * RISK_UNIT);
        bits |= static_cast<Flags>((1.0 - safe) / RISK_UNIT + 0.5) << RISK_SHIFT;
    }
    return bits;
}

}  // namespace serp
