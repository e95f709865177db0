#include "serp/planning/lookahead.hpp"

#include <nanobind/stl/pair.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <future>
#include <stdexcept>
#include <string>
#include <system_error>

namespace serp {

namespace {

constexpr Flags BITS = 0x1F;
/// Ways on are followed to so many times the depth, and so many are enough.
constexpr int FARTHER = 4, WAYS = 2;

}  // namespace

Lookahead::Lookahead(const Model& model, const LookaheadRules& rules)
    : model_(model), rules_(rules), width_(model.fluents()), actions_(model.actions()),
      stepper_(model.stepper()) {}

LookaheadForecast Lookahead::forecast(const double* state, const CellValues* leaves) {
    LookaheadForecast found{FirstActions(actions_)};
    states_.resize(width_ + 1);
    std::copy_n(state, width_, states_.data());
    stored_ = 1;
    int start = 0, end = 1;
    for (; found.depth < rules_.depth; ++found.depth) {
        if (start == end || end > rules_.max_nodes) {
            found.bound = start == end ? Bound::EXHAUSTED : Bound::NODES;
            break;
        }
        if (!expand(start, end, found.depth, leaves, found)) {
            found.bound = Bound::NODES;
            break;
        }
        start = end;
        end = stored_;
    }
    paths_.resize(start);
    for (int node = start - 1; node >= 0; --node) choose(node, start, found.first);
    if (farther_) look_farther(state, found, found.depth);
    return found;
}

/// Takes SAFE from first actions that leave too few ways on, where others leave more; the choice is then
/// among those. Returns whether nothing was taken.
///
/// It is an approximation of the viability kernel (Aubin, "Viability theory", 1991) by the states from
/// which simple ways go on (model predictive shielding: Bastani, ACC 2021). One way on is as good as
/// the model is exact; a second one is there when the first fails. Where the ways have too many edges,
/// nothing is taken.
bool Lookahead::look_farther(const double* state, LookaheadForecast& found, int depth) {
    FirstActions& first = found.first;
    const int horizon = FARTHER * rules_.depth;
    const std::int64_t limit = found.followed + rules_.max_edges;
    ways_.resize((horizon + std::size_t{3}) * (width_ + 1));
    std::vector<int> safe, ways;
    for (int action = 0; action < actions_; ++action) {
        if (first.safe_steps[action] != SAFE) continue;
        stepper_->from(state);
        const Flags flags = stepper_->step(action, ways_.data());
        safe.push_back(action);
        ways.push_back(flags & TERMINAL ? WAYS : ways_on(horizon, found.followed, limit));
        if (found.followed > limit) return true;
    }
    const int most = safe.empty() ? 0 : *std::max_element(ways.begin(), ways.end());
    bool all = true, chosen = false;
    for (std::size_t k = 0; k < safe.size(); ++k) {
        if (ways[k] >= most) continue;
        first.safe_steps[safe[k]] = depth, all = false;
        first.path_risk[safe[k]] = 1.0;
        chosen = chosen || first.choice == safe[k];
    }
    if (!chosen) return all;
    first.choice = -1;
    for (const int action : safe)
        if (first.safe_steps[action] == SAFE &&
            (first.choice < 0 || first.value[action] > first.value[first.choice]))
            first.choice = action;
    return all;
}

/// Returns with how many actions a way on begins in the state of the first row of `ways_`, at most WAYS:
/// it holds an action, and from some control period on another one, without risk up to the horizon.
/// Ends early beyond a limit of edges.
int Lookahead::ways_on(int horizon, std::int64_t& followed, std::int64_t limit) {
    const std::size_t width = width_ + std::size_t{1};
    const auto row = [&](int at) { return ways_.data() + at * width; };
    double *now = row(horizon + 1), *next = row(horizon + 2);
    const auto goes_on = [&](int action, const double* from, double* to, bool& ends) {
        stepper_->from(from);
        const Flags flags = stepper_->step(action, to);
        ++followed;
        const bool safe = flags & APPLICABLE && step_risk(flags, rules_.accepted) == 0.0;
        ends = safe && flags & TERMINAL;
        return safe;
    };
    int count = 0;
    for (int action = 0; action < actions_ && count < WAYS; ++action) {
        int held = 0;
        bool ends = false;
        while (held < horizon && !ends && goes_on(action, row(held), row(held + 1), ends)) ++held;
        bool safe = ends || held == horizon;
        for (int at = held; at > 0 && !safe; --at)
            for (int other = 0; other < actions_ && !safe; ++other) {
                if (followed > limit) return count;
                if (other == action) continue;
                std::copy_n(row(at), width, now);
                int on = at;
                ends = false;
                for (; on < horizon && !ends && goes_on(other, now, next, ends); ++on)
                    std::copy_n(next, width, now);
                safe = ends || on == horizon;
            }
        count += safe;
    }
    return count;
}

/// Expands the nodes of a layer; returns whether there was room for its edges.
bool Lookahead::expand(int start, int end, int depth, const CellValues* leaves,
                             LookaheadForecast& found) {
    const bool last = depth + 1 == rules_.depth;
    const int ways = model_.branches() ? 2 : 1;
    const int most = std::min<std::int64_t>(rules_.max_nodes,
                                            std::int64_t{end - start} * actions_ * ways + end);
    const std::size_t rows = last ? end + 1 : most + 1;
    if (states_.size() < rows * (width_ + 1)) states_.resize(rows * (width_ + 1));
    const std::size_t edges = static_cast<std::size_t>(end) * actions_;
    if (edges_.size() < edges) edges_.resize(edges);
    if (!last) table_.clear(std::max(1, most - end));
    for (int node = start; node < end;) {
        const Steps steps = stepper_->steps(state_at(node), end - node);
        for (int k = 0; k < steps.states; ++k, ++node) {
            for (int action = 0; action < actions_; ++action)
                follow(steps, action * steps.apart + k, node, action, depth, leaves, found);
            if (found.followed > rules_.max_edges && depth > 0) return false;
        }
    }
    return true;
}

/// Adds the edge of a node by an action, whose step is in a lane.
void Lookahead::follow(const Steps& steps, std::ptrdiff_t lane, int node, int action, int depth,
                       const CellValues* leaves, LookaheadForecast& found) {
    const bool last = depth + 1 == rules_.depth;
    const double* numbers = steps.numbers + lane * steps.lane;
    const double risk = step_risk(steps.flags[lane], rules_.accepted);
    const Flags flags = marked(steps.flags[lane], risk);
    Edge& edge = edges_[static_cast<std::size_t>(node) * actions_ + action];
    const double chance = steps.chances ? steps.chances[lane] : 0.0;
    edge = {numbers[width_ * steps.row], risk, chance, -1, -1, static_cast<std::uint8_t>(flags & BITS),
            static_cast<std::uint8_t>(rank_of(flags)),
            static_cast<std::uint16_t>(flags >> END_SHIFT)};
    if (depth == 0) {
        found.first.reward[action] = edge.reward;
        found.first.flags[action] = flags;
    }
    if (!(flags & APPLICABLE)) return;
    ++found.followed;
    found.followed += chance > 0.0;
    if (last && !leaves) return;
    double value = 0.0;
    const auto lead_to = [&](const double* from, std::ptrdiff_t apart) {
        const int position = std::min(stored_, rules_.max_nodes);
        double* out = state_at(position);
        for (int f = 0; f < width_; ++f) out[f] = from[f * apart];
        if (!last) return child_of(position);
        value = leaves->at(out);
        return -1;
    };
    if (!(flags & TERMINAL)) edge.child = lead_to(numbers, steps.row);
    double rest = value;
    if (chance > 0.0) {
        edge.written = lead_to(steps.written + lane * steps.lane, 1);
        rest = (1.0 - chance) * rest + chance * value;
    }
    if (last) edge.reward += rules_.discount * going_on(flags) * rest;
}

/// Returns the node of the next layer with the state at a position, behind all nodes. It is a new one
/// where there is none; -1 where that is one too many, and all nodes of the layer are leaves.
int Lookahead::child_of(int position) {
    if (stored_ > rules_.max_nodes) return -1;
    const double* state = state_at(position);
    const int node = table_.find_or_add(
        digest_of_row(state, width_), position,
        [this, state](int other) { return std::equal(state, state + width_, state_at(other)); },
        [this](int other) { return digest_of_row(state_at(other), width_); });
    if (node == position && ++stored_ > rules_.max_nodes) return -1;
    return node;
}

/// Returns the value of what follows an edge, discounted.
///
/// What the file says an action is for is followed beside a likelier outcome: a reduced model with two
/// outcomes (Pineda & Zilberstein, ICAPS 2014). With the likeliest one alone, an action that fails more
/// often than not would seem to be of no use, and would not be tried again.
double Lookahead::value_after(const Edge& edge, int expanded) const {
    const double weight = edge.end ? going_on(Flags{edge.end} << END_SHIFT) : 1.0;
    const auto value = [&](int node) {
        return 0 <= node && node < expanded ? paths_[node].value : 0.0;
    };
    double rest = value(edge.child);
    if (edge.chance > 0.0) rest = (1.0 - edge.chance) * rest + edge.chance * value(edge.written);
    return rules_.discount * weight * rest;
}

/// Finds the best path from a node of the first `expanded` ones, whose children are known. What is
/// found for every action remains in `first` for the last node, 0.
void Lookahead::choose(int node, int expanded, FirstActions& first) {
    const Edge* edges = edges_.data() + static_cast<std::size_t>(node) * actions_;
    PathScore best;
    int chosen = -1;
    bool chance = false, undefined = false;
    for (int action = 0; action < actions_; ++action) {
        const Edge& edge = edges[action];
        if (!(edge.flags & APPLICABLE)) {
            first.value[action] = -std::numeric_limits<double>::infinity();
            first.path_risk[action] = 1.0, first.safe_steps[action] = -1;
            if (node == 0) first.reward[action] = 0.0;
            undefined = undefined || edge.flags & UNDEFINED;
            continue;
        }
        PathScore score{edge.rank, edge.risk, SAFE, edge.reward};
        score.value += value_after(edge, expanded);
        if (0 <= edge.child && edge.child < expanded) {
            const Path& rest = paths_[edge.child];
            score.risk += (1.0 - score.risk) * rest.risk;
            score.steps = rest.steps == SAFE ? SAFE : rest.steps + 1;
        }
        if (edge.risk > 0.0) score.steps = 0;
        first.value[action] = score.value, first.path_risk[action] = score.risk;
        first.safe_steps[action] = score.steps;
        if (chosen < 0 || score > best) chosen = action, best = score;
        chance = chance || (0.0 < score.risk && score.risk < 1.0);
    }
    // No result can be predicted there, so no action is known to be safe.
    if (chosen < 0 && undefined) best.risk = 1.0, best.steps = 0;
    if (chance && rules_.accepted > 0.0)
        for (int action = 0; action < actions_; ++action) {
            if (!(edges[action].flags & APPLICABLE) || edges[action].rank != best.rank ||
                !within_slack(first.path_risk[action], best.risk, rules_.accepted))
                continue;
            first.path_risk[action] = best.risk, first.safe_steps[action] = best.steps;
            const double value = first.value[action];
            if (value > best.value || (value == best.value && action < chosen))
                chosen = action, best.value = value;
        }
    paths_[node] = {best.value, best.risk, best.steps, chosen};
    first.choice = chosen;
}

LookaheadForecast Lookahead::check_safety(const double* state) {
    LookaheadForecast found{FirstActions(actions_)};
    FirstActions& first = found.first;
    // The states after the first actions come first, then those along a path.
    const std::size_t rows = static_cast<std::size_t>(actions_) + rules_.depth;
    if (states_.size() < rows * (width_ + 1)) states_.resize(rows * (width_ + 1));
    stepper_->from(state);
    for (int action = 0; action < actions_; ++action) {
        double* out = state_at(action);
        const Flags predicted = stepper_->step(action, out);
        const double risk = step_risk(predicted, rules_.accepted);
        const Flags flags = first.flags[action] = marked(predicted, risk);
        if (!(flags & APPLICABLE)) continue;
        ++found.followed;
        first.value[action] = std::numeric_limits<double>::quiet_NaN();
        first.reward[action] = out[width_];
        first.path_risk[action] = risk;
        first.safe_steps[action] = 0;
    }
    bool some = false, all = true;
    for (int action = 0; action < actions_; ++action) {
        if (!(first.flags[action] & APPLICABLE) || first.path_risk[action] > 0.0) continue;
        const bool safe = first.flags[action] & TERMINAL ||
                          safe_path_from(state_at(action), 1, found.followed);
        first.safe_steps[action] = safe ? SAFE : 0;
        some = some || safe;
        all = all && safe;
    }
    if (farther_) all = look_farther(state, found, rules_.depth) && all;
    found.bound = some && all ? Bound::SAFETY : Bound::NODES;
    return found;
}

/// Returns whether a path without risk begins in a state at a depth, as far as few edges show.
bool Lookahead::safe_path_from(const double* state, int depth, std::int64_t& followed) {
    if (depth == rules_.depth) return true;
    // As many as it takes to try all actions in every state of one path by each first action.
    const std::int64_t most =
        std::min(rules_.max_edges, std::int64_t{rules_.depth} * actions_ * actions_);
    double* out = state_at(actions_ + depth - 1);
    bool applicable = false, undefined = false, elsewhere = true;
    for (int action = 0; action < actions_; ++action) {
        if (followed >= most) return false;
        if (elsewhere) stepper_->from(state);
        const Flags flags = stepper_->step(action, out);
        elsewhere = false;
        undefined = undefined || flags & UNDEFINED;
        if (!(flags & APPLICABLE)) continue;
        ++followed;
        applicable = true;
        if (step_risk(flags, rules_.accepted) > 0.0) continue;
        if (flags & TERMINAL || safe_path_from(out, depth + 1, followed)) return true;
        elsewhere = true;
    }
    return !applicable && !undefined;
}

std::vector<LookaheadForecast> Lookahead::forecast_batch(const double* states, int count,
                                                         const CellValues* leaves, int threads) {
    threads = std::max(1, std::min(threads, count));
    while (static_cast<int>(others_.size()) < threads - 1)
        others_.push_back(std::make_unique<Lookahead>(model_, rules_));
    std::vector<LookaheadForecast> found(count, LookaheadForecast{FirstActions(0)});
    const auto part = [&](int thread) {
        Lookahead& its = thread ? *others_[thread - 1] : *this;
        its.farther_ = farther_;
        for (int k = thread; k < count; k += threads)
            found[k] = its.forecast(states + static_cast<std::size_t>(k) * width_, leaves);
    };
    std::vector<std::future<void>> others;
    others.reserve(threads);
    int alone = 1;  // the first part that no thread could be had for
    try {
        for (; alone < threads; ++alone)
            others.push_back(std::async(std::launch::async, part, alone));
    } catch (const std::system_error&) {
    }
    part(0);
    for (int thread = alone; thread < threads; ++thread) part(thread);
    for (auto& other : others) other.get();
    return found;
}

// For Python ---------------------------------------------------------------------------------------

namespace {

/// The fields of a `Forecast`, and the edges that were followed for it.
using Result = std::pair<ForecastTuple, std::int64_t>;

Result result_of(LookaheadForecast&& of) {
    return {forecast_tuple(std::move(of.first), of.depth, of.bound), of.followed};
}

void check_width(const Lookahead& lookahead, std::size_t numbers, const CellValues* leaves) {
    if (numbers != static_cast<std::size_t>(lookahead.width()) ||
        (leaves && leaves->width() != lookahead.width()))
        throw std::invalid_argument("a state must have " + std::to_string(lookahead.width()) +
                                    " numbers");
}

Result forecast_of(Lookahead& lookahead, const In<double, nb::ndim<1>>& state,
                   const CellValues* leaves) {
    check_width(lookahead, state.size(), leaves);
    return result_of(lookahead.forecast(state.data(), leaves));
}

std::vector<Result> forecast_batch(Lookahead& lookahead, const In<double, nb::ndim<2>>& states,
                                   const CellValues* leaves, int threads) {
    check_width(lookahead, states.shape(1), leaves);
    std::vector<Result> results;
    for (auto& found : lookahead.forecast_batch(
             states.data(), static_cast<int>(states.shape(0)), leaves, threads))
        results.push_back(result_of(std::move(found)));
    return results;
}

std::vector<std::tuple<double, double, std::int64_t, int>> paths_of(const Lookahead& of) {
    std::vector<std::tuple<double, double, std::int64_t, int>> paths;
    for (const auto& path : of.paths())
        paths.emplace_back(path.value, path.risk, path.steps, path.action);
    return paths;
}

}  // namespace

void bind_lookahead(nb::module_& module) {
    nb::class_<Lookahead>(module, "Lookahead", "The planning graph of one state with a depth.")
        .def("__init__", [](Lookahead* self, const Model& model, int depth, double discount,
                            double accepted_risk, int max_nodes, std::int64_t max_edges) {
                if (depth < 1 || max_nodes < 1)
                    throw std::invalid_argument("depth and max_nodes must be positive");
                new (self) Lookahead(model, {depth, discount, accepted_risk, max_nodes, max_edges});
            }, nb::arg("model"), nb::arg("depth"), nb::arg("discount"), nb::arg("accepted_risk"),
            nb::arg("max_nodes"), nb::arg("max_edges"), nb::keep_alive<1, 2>())
        .def("forecast", &forecast_of, nb::arg("state"), nb::arg("leaves").none(),
             "Return the fields of a `Forecast` for a state [F], and the edges followed for it.")
        .def("check_safety", [](Lookahead& lookahead, const In<double, nb::ndim<1>>& state) {
                return result_of(lookahead.check_safety(state_of(state, lookahead.width())));
            }, nb::arg("state"), "Return what says only which actions are safe, as `forecast` does.")
        .def("forecast_batch", &forecast_batch, nb::arg("states"), nb::arg("leaves").none(),
             nb::arg("threads"), "Return what `forecast` returns for states [B, F].")
        .def_rw("farther", &Lookahead::farther_,
                "Whether a first action counts as safe only if it leaves as many ways on as others.")
        .def("paths", &paths_of,
             "Return value, risk, safe steps and first action (-1 for none) of the best path from "
             "each expanded state of the newest forecast, in the order in which they were found.");
}

}  // namespace serp
