// The flags of a predicted step; the counterpart of flags.py, which documents them.
#pragma once

#include <cstdint>

namespace serp {

using Flags = std::int64_t;

inline constexpr Flags APPLICABLE = 1, UNSAFE = 2, TERMINAL = 4, UNDEFINED = 8, RISKY = 16;
inline constexpr int RISK_SHIFT = 8;
inline constexpr double RISK_UNIT = 1.0 / (1 << 24);

/// Adds a risk in [0, 1], rounded to a multiple of 2^-24, to flags without one.
inline Flags with_risk(Flags flags, double risk) {
    return flags | (static_cast<Flags>(risk / RISK_UNIT + 0.5) << RISK_SHIFT);
}

/// Returns the flags of two consecutive steps: the bits of both, and their joint risk.
inline Flags joined(Flags flags, Flags further) {
    Flags bits = (flags | further) & 0xFF;
    const Flags first = flags >> RISK_SHIFT, second = further >> RISK_SHIFT;
    if (first | second) {
        const double safe = (1.0 - first * RISK_UNIT) * (1.0 - second * RISK_UNIT);
        bits |= static_cast<Flags>((1.0 - safe) / RISK_UNIT + 0.5) << RISK_SHIFT;
    }
    return bits;
}

}  // namespace serp
