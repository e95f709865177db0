#include "serp/planning/cells.hpp"

#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>

#include "serp/_util/arrays.hpp"

namespace serp {

namespace {

/// Returns the bin of a number; NaN lies in the lowest one.
std::int64_t bin_of(double number, double low, double scale) {
    constexpr double FAR = 1e9;
    const double place = std::floor((number - low) * scale);
    return static_cast<std::int64_t>(place > -FAR ? std::min(place, FAR) : -FAR);
}

/// Returns what a fluent, whose scale is not negative, contributes to the digest of a cell.
std::uint64_t bits_in_cell(const Cells& cells, const double* state, int i) {
    return cells.scale[i] > 0.0 ? bin_of(state[i], cells.low[i], cells.scale[i])
                                : bits_of(state[i]);
}

}  // namespace

Cells::Cells(std::vector<double> low, std::vector<double> scale, std::vector<double> area)
    : low(std::move(low)), scale(std::move(scale)), area(std::move(area)) {
    if (this->scale.size() != this->low.size() || this->area.size() != this->low.size())
        throw std::invalid_argument("low, scale and area differ in length");
}

Digest Cells::cell_of(const double* state) const {
    Digest digest = START;
    for (int i = 0; i < width(); ++i)
        if (scale[i] >= 0.0) digest = mixed(digest, bits_in_cell(*this, state, i));
    return finished(digest);
}

Digest Cells::area_of(const double* state) const {
    Digest digest = START;
    for (int i = 0; i < width(); ++i)
        if (area[i] > 0.0) digest = mixed(digest, bin_of(state[i], low[i], area[i]));
    return finished(digest);
}

bool Cells::in_range(const double* state) const {
    for (int i = 0; i < width(); ++i) {
        const double place = (state[i] - low[i]) * area[i];
        if (!(-MARGIN <= place && place <= AREAS + MARGIN)) return false;
    }
    return true;
}

double Cells::nearness(const double* state, const double* other) const {
    double total = 0.0;
    for (int i = 0; i < width(); ++i) {
        const double off = (state[i] - other[i]) * std::max(0.0, scale[i]);
        total += off * off;
    }
    return std::exp(-2.0 * total) + 1e-9;
}

void CellsBeside::from(const double* state) {
    Digest digest = START;
    for (int i = 0; i < cells_.width(); ++i) {
        before_[i] = digest;
        if (!(cells_.scale[i] >= 0.0)) continue;
        bits_[i] = bits_in_cell(cells_, state, i);
        digest = mixed(digest, bits_[i]);
    }
}

Digest CellsBeside::digest_of(int fluent, int by) const {
    Digest digest = mixed(before_[fluent], bits_[fluent] + by);
    for (int i = fluent + 1; i < cells_.width(); ++i)
        if (cells_.scale[i] >= 0.0) digest = mixed(digest, bits_[i]);
    return finished(digest);
}

CellValues::CellValues(Cells cells, std::vector<double> states, std::vector<double> value,
                       std::optional<std::vector<double>> area_value)
    : cells_(std::move(cells)), states_(std::move(states)), value_(std::move(value)) {
    if (value_.empty() || states_.size() != (value_.size() - 1) * cells_.width())
        throw std::invalid_argument(std::to_string(states_.size()) + " numbers of states for " +
                                    std::to_string(value_.size()) + " values");
    const int count = static_cast<int>(value_.size()) - 1;
    std::vector<double> least;
    double least_of_all = std::numeric_limits<double>::infinity();
    for (int k = 0; k < count; ++k) {
        const double* state = states_.data() + static_cast<std::size_t>(k) * cells_.width();
        if (cell_index_.find_or_add(cells_.cell_of(state)) != k)
            throw std::invalid_argument("two states in one cell");
        const int area = area_index_.find_or_add(cells_.area_of(state));
        least.resize(area_index_.size(), std::numeric_limits<double>::infinity());
        least[area] = std::min(least[area], value_[k]);
        least_of_all = std::min(least_of_all, value_[k]);
    }
    least.push_back(count ? least_of_all : 0.0);
    area_value_ = area_value ? std::move(*area_value) : std::move(least);
    if (area_value_.size() != static_cast<std::size_t>(area_index_.size()) + 1)
        throw std::invalid_argument("area_value has " + std::to_string(area_value_.size()) +
                                    " numbers, not " + std::to_string(area_index_.size() + 1));
}

double CellValues::at(const double* state) const {
    double weights = 0.0, total = 0.0;
    const int width = cells_.width();
    auto add = [&](int cell) {
        const double weight =
            cells_.nearness(state, states_.data() + static_cast<std::size_t>(cell) * width);
        weights += weight;
        total += weight * value_[cell];
    };
    if (const int own = cell_index_.find(cells_.cell_of(state)); own >= 0) {
        add(own);
        CellsBeside beside(cells_);
        beside.from(state);
        for (int i = 0; i < width; ++i) {
            if (!(cells_.scale[i] > 0.0)) continue;
            for (const int by : {-1, 1})
                if (const int cell = cell_index_.find(beside.digest_of(i, by)); cell >= 0)
                    add(cell);
        }
    }
    if (weights > 0.0) return total / weights;
    const int area = area_index_.find(cells_.area_of(state));
    if (area >= 0) return area_value_[area];
    return cells_.in_range(state) ? area_value_.back() : value_.back();
}

void CellValues::set(const double* state, double value) {
    if (const int cell = cell_index_.find(cells_.cell_of(state)); cell >= 0) value_[cell] = value;
}

// For Python ---------------------------------------------------------------------------------------

namespace {

using Numbers = In<double, nb::ndim<1>>;

std::map<std::string, Array<double>> columns_of(const CellValues& values) {
    auto copy_of = [](std::vector<double> numbers) {
        const std::size_t count = numbers.size();
        return array_of(std::move(numbers), {count});
    };
    const Cells& cells = values.cells();
    return {{"low", copy_of(cells.low)},          {"scale", copy_of(cells.scale)},
            {"area", copy_of(cells.area)},        {"states", copy_of(values.states())},
            {"value", copy_of(values.value())},   {"area_value", copy_of(values.area_value())}};
}

}  // namespace

void bind_cells(nb::module_& module) {
    module.attr("AREAS") = AREAS;
    nb::class_<CellValues>(module, "CellValues", "The values of N cells, see cells.hpp.")
        .def("__init__", [](CellValues* self, const Numbers& low, const Numbers& scale,
                            const Numbers& area, const Numbers& states, const Numbers& value,
                            const std::optional<Numbers>& area_value) {
                std::optional<std::vector<double>> least;
                if (area_value) least = vector_of(*area_value);
                new (self) CellValues({vector_of(low), vector_of(scale), vector_of(area)},
                                      vector_of(states), vector_of(value), std::move(least));
            }, nb::arg("low"), nb::arg("scale"), nb::arg("area"), nb::arg("states"),
            nb::arg("value"), nb::arg("area_value") = nb::none())
        .def("at", [](const CellValues& values, const Numbers& state) {
                return values.at(state_of(state, values.width()));
            }, nb::arg("state"))
        .def("set", [](CellValues& values, const Numbers& state, double value) {
                values.set(state_of(state, values.width()), value);
            }, nb::arg("state"), nb::arg("value"))
        .def_prop_ro("unknown", [](const CellValues& of) { return of.value().back(); },
                     "The value of what is not known.")
        .def("columns", &columns_of, "Return copies of what the values are made from, by name.");
}

}  // namespace serp
