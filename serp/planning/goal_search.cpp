// The search for a way to the goal, with two queues: one by novelty, one by relaxed cost.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <new>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "serp/_util/arrays.hpp"
#include "serp/model/model.hpp"
#include "serp/planning/hash_table.hpp"
#include "serp/planning/preference.hpp"
#include "serp/planning/relaxation.hpp"

namespace serp {

namespace {

/// States that lack more conditions of the goal than this are taken to lack as many.
constexpr int MOST_LEFT = 100;
/// Queues of both orders; the last one by cost has all states from which the goal costs more.
constexpr int BY_NOVELTY = 3 * (MOST_LEFT + 1), BY_COST = 2'000;
/// Most bytes in the states of a search.
constexpr std::int64_t MAX_BYTES = 320'000'000;

/// Queues of nodes. Every node is appended to one of them, in the order of the nodes.
class Queues {
public:
    explicit Queues(int count) : first_(count, -1), last_(count, -1), lowest_(count) {}

    void append(int queue, int node) {
        following_.push_back(-1);
        if (first_[queue] < 0)
            first_[queue] = node;
        else
            following_[last_[queue]] = node;
        last_[queue] = node;
        lowest_ = std::min(lowest_, queue);
    }

    /// Removes and returns the next node of the first queue that has one; -1 where none has.
    int next() {
        for (; lowest_ < static_cast<int>(first_.size()); ++lowest_) {
            const int node = first_[lowest_];
            if (node < 0) continue;
            first_[lowest_] = following_[node];
            return node;
        }
        return -1;
    }

private:
    std::vector<std::int32_t> first_, last_, following_;
    int lowest_;  ///< no queue before this one has a node
};

/// A set of values and pairs of values, as bits at their hashes.
class Seen {
public:
    /// Adds a hash; returns whether it was new.
    bool add(Digest key) {
        const Digest place = key >> (64 - BITS), bit = Digest{1} << (place & 63);
        Digest& word = words_[place >> 6];
        const bool is_new = !(word & bit);
        word |= bit;
        return is_new;
    }

private:
    static constexpr int BITS = 26;
    std::vector<Digest> words_ = std::vector<Digest>(std::size_t{1} << (BITS - 6));
};

/// A search tree. `Number` is the type of the numbers in its states: bytes where all are 0 or 1.
template <class Number>
class WaySearch {
public:
    /// `followed` receives the number of edges that were followed.
    WaySearch(const Model& model, const Relaxation& relaxation, std::vector<std::int64_t> inert,
              double accepted_risk, std::int64_t& followed)
        : model_(model), width_(model.fluents()), inert_(std::move(inert)),
          accepted_risk_(accepted_risk), followed_(followed), costs_(relaxation), atoms_(width_) {}

    /// Searches from a state [F] for an edge that reaches the goal, and follows at most about
    /// `limit` edges. Returns the node that the edge leaves; -1 where none was found.
    int search(const double* root, std::int64_t limit);

    /// Returns the states [N * F] on the way to a node.
    std::vector<double> way(int node) const;

private:
    int nodes() const { return static_cast<int>(parent_.size()); }
    const Number* state(int node) const {
        return states_.data() + static_cast<std::size_t>(node) * width_;
    }
    void add(double* row, int parent);
    int novelty(int node);

    const Model& model_;
    int width_;
    std::vector<std::int64_t> inert_;
    double accepted_risk_;
    std::int64_t& followed_;
    RelaxedCosts costs_;

    HashTable table_;                   ///< nodes by their states
    std::vector<Number> states_;        ///< [N * F], inert fluents are 0
    std::vector<std::int32_t> parent_;  ///< [N] node that each was reached from; -1 of the root
    std::vector<std::uint8_t> left_;    ///< [N] conditions of the goal that do not hold
    std::vector<std::uint8_t> done_;    ///< [N] whether the node is expanded
    Queues by_novelty_{BY_NOVELTY}, by_cost_{BY_COST};
    Seen seen_;
    std::vector<Digest> atoms_;         ///< [F] scratch memory
};

/// Adds a node with a state [F] if there is none; inert fluents become 0.
template <class Number>
void WaySearch<Number>::add(double* row, int parent) {
    for (const auto fluent : inert_) row[fluent] = 0.0;
    const int node = nodes();
    const int found = table_.find_or_add(
        digest_of_row(row, width_), node,
        [&](int other) { return std::equal(row, row + width_, state(other)); },
        [&](int other) { return digest_of_row(state(other), width_); });
    if (found != node) return;
    for (int i = 0; i < width_; ++i) {
        if constexpr (sizeof(Number) == 1)
            states_.push_back(row[i] != 0.0);
        else
            states_.push_back(row[i]);
    }
    parent_.push_back(parent);
    done_.push_back(0);
    const auto [cost, left] = costs_.estimate(row);
    left_.push_back(static_cast<std::uint8_t>(std::min(left, MOST_LEFT)));
    by_novelty_.append((novelty(node) - 1) * (MOST_LEFT + 1) + left_[node], node);
    // Rounding may make a sum of large and small costs negative.
    by_cost_.append(cost > 0.0 ? static_cast<int>(std::min(cost, BY_COST - 1.0)) : 0, node);
}

/// Returns the novelty of a node, and remembers its values and pairs: 1 where a value is new among
/// the states that lack as many conditions of the goal, 2 where a pair of values is, else 3.
template <class Number>
int WaySearch<Number>::novelty(int node) {
    const int parent = parent_[node];
    const bool everything = parent < 0 || left_[parent] != left_[node];
    const Digest group = mixed(START, left_[node]);
    const Number* row = state(node);
    const Number* former = everything ? row : state(parent);
    int count = 0;
    auto remember = [&](int i) {
        atoms_[count++] = finished(mixed(mixed(group, i), bits_of(row[i])));
    };
    for (int i = 0; i < width_; ++i)  // the values that changed come first
        if (everything ? row[i] != 0 : row[i] != former[i]) remember(i);
    const int changed = count;
    for (int i = 0; i < width_ && !everything; ++i)
        if (row[i] != 0 && row[i] == former[i]) remember(i);
    bool single = false, pair = false;
    for (int k = 0; k < changed; ++k) single |= seen_.add(atoms_[k]);
    for (int k = 0; k < changed; ++k)
        for (int j = k + 1; j < count; ++j) {
            const auto [low, high] = std::minmax(atoms_[k], atoms_[j]);
            pair |= seen_.add(finished(mixed(low, high)));
        }
    return single ? 1 : pair ? 2 : 3;
}

template <class Number>
int WaySearch<Number>::search(const double* root, std::int64_t limit) {
    const int actions = model_.actions();
    const std::int64_t most = std::min({limit, MAX_BYTES / (std::max(1, width_) *
                                                            static_cast<std::int64_t>(sizeof(Number))),
                                        std::int64_t{std::numeric_limits<std::int32_t>::max()} -
                                            actions - 1});
    const auto stepper = model_.stepper();
    std::vector<double> source(root, root + width_), target(width_ + 1);
    add(source.data(), -1);
    for (std::int64_t expanded = 0; followed_ < limit; ++expanded) {
        int node;
        do node = (expanded % 2 ? by_cost_ : by_novelty_).next();
        while (node >= 0 && done_[node]);
        if (node < 0 || nodes() > most + 1) break;
        done_[node] = 1;
        std::copy_n(state(node), width_, source.begin());
        stepper->from(source.data());
        for (int action = 0; action < actions; ++action) {
            const Flags flags = stepper->step(action, target.data());
            if (!(flags & APPLICABLE)) continue;
            ++followed_;
            if (step_risk(flags, accepted_risk_) > 0.0) continue;
            if (!(flags & TERMINAL))
                add(target.data(), node);
            else if (target[width_] > 0.0)
                return node;
        }
    }
    return -1;
}

template <class Number>
std::vector<double> WaySearch<Number>::way(int node) const {
    std::vector<int> nodes;
    for (; node >= 0; node = parent_[node]) nodes.push_back(node);
    std::vector<double> states;
    for (auto at = nodes.rbegin(); at != nodes.rend(); ++at)
        states.insert(states.end(), state(*at), state(*at) + width_);
    return states;
}

// For Python ---------------------------------------------------------------------------------------

/// Returns the states [N, F] on a way; none where none was found.
template <class Number>
std::optional<Array<double>> way_of(const Model& model, const Relaxation& relaxation,
                                    std::vector<std::int64_t> inert, double accepted_risk,
                                    const double* state, std::int64_t limit,
                                    std::int64_t& followed) {
    try {
        WaySearch<Number> tree(model, relaxation, std::move(inert), accepted_risk, followed);
        const int node = tree.search(state, limit);
        if (node < 0) return std::nullopt;
        const auto width = static_cast<std::size_t>(std::max(1, model.fluents()));
        std::vector<double> states = tree.way(node);
        const std::size_t count = states.size() / width;
        return array_of(std::move(states), {count, static_cast<std::size_t>(model.fluents())});
    } catch (const std::bad_alloc&) {  // no memory: no way was found
        return std::nullopt;
    }
}

std::pair<std::int64_t, std::optional<Array<double>>> find_way(
    const Model& model, const Relaxation& relaxation,
    const In<std::int64_t, nb::ndim<1>>& inert, bool binary, double accepted_risk,
    const In<double, nb::ndim<1>>& state, std::int64_t limit) {
    if (relaxation.fluents() != model.fluents() ||
        state.size() != static_cast<std::size_t>(model.fluents()))
        throw std::invalid_argument("model, relaxation and state differ in their fluents");
    const std::vector<std::int64_t> fluents = vector_of(inert);
    for (const auto fluent : fluents)
        if (fluent < 0 || fluent >= model.fluents())
            throw std::invalid_argument("there is no fluent " + std::to_string(fluent));
    std::int64_t followed = 0;
    const auto& find = binary ? way_of<std::uint8_t> : way_of<double>;
    auto way = find(model, relaxation, fluents, accepted_risk, state.data(), limit, followed);
    return {followed, std::move(way)};
}

}  // namespace

void bind_relaxation(nb::module_& module);

void bind_goal_search(nb::module_& module) {
    bind_relaxation(module);
    module.def(
        "find_way", &find_way, nb::arg("model"), nb::arg("relaxation"), nb::arg("inert"),
        nb::arg("binary"), nb::arg("accepted_risk"), nb::arg("state"), nb::arg("limit"),
        "Search for a way from a state [F] to the goal. Return the edges that were followed, about "
        "`limit` at most, and the states [N, F] on the way but the last one; None where none was "
        "found. Fluents `inert` become 0 in these. `binary` says that all others are 0 or 1.");
}

}  // namespace serp
