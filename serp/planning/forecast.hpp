// The prediction for every first action in one state.
#pragma once

#include <nanobind/stl/tuple.h>

#include <cstdint>
#include <limits>
#include <tuple>
#include <utility>
#include <vector>

#include "serp/_util/arrays.hpp"
#include "serp/model/flags.hpp"

namespace serp {

/// What ended an expansion; the counterpart of `Bound` in forecast.py, which documents it.
enum class Bound : int { DEPTH = 0, NODES = 1, EXHAUSTED = 2, SAFETY = 5 };

/// Choice and columns [A] of `Forecast` in forecast.py, which documents them.
struct FirstActions {
    int choice;
    std::vector<double> value, path_risk;
    std::vector<std::int64_t> safe_steps;
    std::vector<double> reward;
    std::vector<Flags> flags;

    /// No action is applicable.
    explicit FirstActions(int actions)
        : choice(-1), value(actions, -std::numeric_limits<double>::infinity()),
          path_risk(actions, 1.0), safe_steps(actions, -1), reward(actions), flags(actions) {}
};

/// The fields of `Forecast` in their order: choice, columns, depth, bound.
using ForecastTuple = std::tuple<int, Array<double>, Array<double>, Array<std::int64_t>,
                                 Array<double>, Array<Flags>, int, int>;

inline ForecastTuple forecast_tuple(FirstActions&& of, int depth, Bound bound) {
    const size_t actions = of.value.size();
    return {of.choice, array_of(std::move(of.value), {actions}),
            array_of(std::move(of.path_risk), {actions}),
            array_of(std::move(of.safe_steps), {actions}),
            array_of(std::move(of.reward), {actions}), array_of(std::move(of.flags), {actions}),
            depth, static_cast<int>(bound)};
}

}  // namespace serp
