// The order of actions; the counterpart of preference.py, which explains it.
#pragma once

#include <cstdint>
#include <limits>

#include "serp/model/flags.hpp"

namespace serp {

/// Steps to the first risk of a path without any; `forecast.SAFE`.
inline constexpr std::int64_t SAFE = std::int64_t{1} << 30;

/// Returns the risk of one step; 0 where it is accepted.
inline double step_risk(Flags flags, double accepted) {
    if (flags & UNSAFE) return 1.0;
    const Flags units = risk_units(flags);
    if (units == 0) return 0.0;
    const double risk = units * RISK_UNIT;
    return risk > accepted ? risk : 0.0;
}

/// Returns the flags of a step, with RISKY where its risk by `step_risk` is above 0.
inline Flags marked(Flags flags, double risk) {
    return risk > 0.0 && !(flags & UNSAFE) ? flags | RISKY : flags;
}

/// Returns 0 for a step whose risk is accepted, 1 where it is not, 2 where the file flags it.
inline int rank_of(Flags flags) { return flags & UNSAFE ? 2 : flags & RISKY ? 1 : 0; }

/// Returns whether a path of this risk counts as one of the least risk.
inline bool within_slack(double risk, double least, double accepted) {
    return accepted > 0.0 && risk < 1.0 && risk <= least + accepted;
}

/// The score of a path; a better path has a larger one.
struct PathScore {
    int rank = 0;
    double risk = 0.0;
    std::int64_t steps = SAFE;
    double value = 0.0;

    bool operator>(const PathScore& other) const {
        if (rank != other.rank) return rank < other.rank;
        if (risk != other.risk) return risk < other.risk;
        if (steps != other.steps) return steps > other.steps;
        return value > other.value;
    }
};

}  // namespace serp
