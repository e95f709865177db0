// The search for a way to the goal; goal_search.py says how it goes.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/unique_ptr.h>

#include <algorithm>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <new>
#include <optional>
#include <queue>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "serp/_util/arrays.hpp"
#include "serp/model/model.hpp"
#include "serp/planning/hash_table.hpp"
#include "serp/planning/preference.hpp"
#include "serp/planning/relaxation.hpp"

namespace serp {

namespace {

/// Updates of relaxed costs that take as long as an edge of a graph, about 2 µs. All other work is
/// counted as so many updates as it was measured to take.
constexpr std::int64_t WORK = 512;
/// Most bytes of the nodes of a search.
constexpr std::int64_t MAX_BYTES = 150'000'000;
/// Bytes of a node beside its state.
constexpr std::int64_t NODE_BYTES = 128;
/// Most pairs of values of a state that are looked at.
constexpr int MAX_PAIRS = 20'000;
/// So many times a helpful action comes first after the least cost has become less, see LAMA.
constexpr std::int64_t BOOST = 1'000;

/// Nodes in the order of their keys; of equal ones the first comes first, or the last.
class Queue {
public:
    explicit Queue(bool last_first = false) : step_(last_first ? -1 : 1) {}

    void append(double key, int node) {
        nodes_.push({static_cast<float>(key), count_, node});
        count_ += step_;
    }

    bool empty() const { return nodes_.empty(); }

    /// Returns the next node; -1 where there is none.
    int peek() const { return nodes_.empty() ? -1 : std::get<2>(nodes_.top()); }

    /// Removes and returns the next node, of those that there are.
    int next() {
        const int node = peek();
        nodes_.pop();
        return node;
    }

    std::int64_t turns = 0;  ///< how often it was asked, less what it was advanced

private:
    using Entry = std::tuple<float, std::int32_t, std::int32_t>;
    std::priority_queue<Entry, std::vector<Entry>, std::greater<>> nodes_;
    std::int32_t count_ = 0, step_;
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

/// A search for a way to the goal that can be gone on with while the world follows it.
class WaySearch {
public:
    virtual ~WaySearch() = default;
    /// Searches on from a state [F] for an edge that reaches the goal, and follows at most about
    /// `limit` edges, or does as much other work; returns how many, and whether the goal was reached.
    virtual std::pair<std::int64_t, bool> search(const double* state, std::int64_t limit) = 0;
    /// Returns the states [N * F] on the way to the goal that was found, but the last one.
    virtual std::vector<double> way() const = 0;
    /// Returns the action that leads from a state [F] to the goal, where a way was found, else to
    /// the state of the least cost that is known; -1 where there is none.
    virtual int toward(const double* state) = 0;
    /// Returns the least cost of all states of the tree; infinite where the goal is out of reach.
    virtual double least() const = 0;
    /// Returns whether the last search began anew: those before it make no difference.
    virtual bool fresh() const = 0;
    virtual int fluents() const = 0;
};

/// How a search goes: by novelty; by relaxed cost; or by the cost of the relaxed plan of the state
/// before, so that a state is evaluated when its turn comes (lazy greedy search: Richter & Westphal,
/// JAIR 2010).
enum Kind : std::int64_t { NOVEL, GREEDY, LAZY, KINDS };

/// A search tree. `Number` is the type of the numbers in its states: bytes where all are 0 or 1.
template <class Number>
class Tree final : public WaySearch {
public:
    Tree(const Model& model, const Relaxation& relaxation, std::vector<std::int64_t> inert,
         double accepted_risk, Kind kind)
        : kind_(kind), model_(model), stepper_(model.stepper()), width_(model.fluents()),
          inert_(std::move(inert)), accepted_risk_(accepted_risk), costs_(relaxation),
          atoms_(width_), helpful_(model.actions()), source_(width_), target_(width_ + 1) {}

    std::pair<std::int64_t, bool> search(const double* state, std::int64_t limit) override;
    std::vector<double> way() const override;
    int toward(const double* state) override;
    double least() const override { return least_; }
    bool fresh() const override { return fresh_; }
    int fluents() const override { return width_; }

private:
    int nodes() const { return static_cast<int>(parent_.size()); }
    const Number* state(int node) const {
        return states_.data() + static_cast<std::size_t>(node) * width_;
    }
    int find(const double* row) const;
    void enter(const double* row);
    bool add(double* row, int parent, int action);
    void open(int node);
    bool reached(int node);
    int next();
    float evaluate(const double* row);
    void improve(int node);
    bool expand(int node);
    int novelty(int node);

    const Kind kind_;
    const Model& model_;
    const std::unique_ptr<Stepper> stepper_;
    int width_;
    std::vector<std::int64_t> inert_;
    double accepted_risk_;
    RelaxedCosts costs_;

    HashTable table_;                   ///< nodes by their states
    std::vector<Number> states_;        ///< [N * F], inert fluents are 0
    std::vector<std::int32_t> parent_;  ///< [N] node that each was reached from; -1 of the root
    std::vector<std::int32_t> action_;  ///< [N] by which action
    std::vector<std::int32_t> known_;   ///< [N] 2 x number of the root + whether it leads to the node
    std::vector<float> cost_;           ///< [N] relaxed cost of the node, or of its parent
    std::vector<std::int32_t> left_;    ///< [N] conditions of the goal that do not hold, for novelty
    std::vector<std::uint8_t> done_;    ///< [N] whether the node is expanded
    Queue all_, helped_;                ///< of all nodes; of those that a helpful action leads to
    std::optional<Seen> seen_;
    int root_ = -1, best_ = -1, goal_ = -1, last_ = -1;
    /// How many roots there were: a node that is the root again is another one.
    std::int32_t roots_ = 0;
    double least_ = std::numeric_limits<double>::infinity();
    std::int64_t work_ = 0;
    bool full_ = false, fresh_ = true;
    std::vector<Digest> atoms_;         ///< [F] scratch memory
    std::vector<std::uint8_t> helpful_; ///< [A] scratch memory
    std::vector<double> source_, target_;  ///< [F], [F + 1] scratch memory
};

template <class Number>
int Tree<Number>::find(const double* row) const {
    std::vector<double> source(row, row + width_);
    for (const auto fluent : inert_) source[fluent] = 0.0;
    return table_.find(digest_of_row(source.data(), width_), [&](int other) {
        return std::equal(source.begin(), source.end(), state(other));
    });
}

/// Makes a state the root: what it does not lead to is left out from now on. A tree that does not
/// hold the state, or has no room left, begins anew.
template <class Number>
void Tree<Number>::enter(const double* row) {
    const bool room = !full_ && roots_ < std::numeric_limits<std::int32_t>::max() / 2;
    const int node = root_ < 0 || !room ? -1 : find(row);
    if (node >= 0 && reached(node)) {
        if (node != root_) ++roots_;
        fresh_ = false;
        parent_[node] = -1;
        root_ = node;
        return;
    }
    table_.clear();
    states_.clear(), parent_.clear(), action_.clear(), known_.clear(), cost_.clear();
    left_.clear(), done_.clear();
    all_ = Queue(kind_ != NOVEL), helped_ = Queue(kind_ != NOVEL);
    if (kind_ == NOVEL) seen_.emplace();
    root_ = 0, roots_ = 1, best_ = -1, goal_ = -1, full_ = false, fresh_ = true;
    least_ = std::numeric_limits<double>::infinity();
    std::copy_n(row, width_, target_.begin());
    add(target_.data(), -1, -1);
}

/// Returns whether the root leads to a node.
template <class Number>
bool Tree<Number>::reached(int node) {
    int at = node;
    while (at >= 0 && at != root_ && known_[at] / 2 != roots_) at = parent_[at];
    const int known = 2 * roots_ + (at == root_ || (at >= 0 && known_[at] % 2));
    for (int on = node; on != at; on = parent_[on]) known_[on] = known;
    return known % 2;
}

/// Adds a node with a state [F] if there is none; inert fluents become 0. Returns whether the node is
/// worth going to: not if it is known to be a dead end.
template <class Number>
bool Tree<Number>::add(double* row, int parent, int action) {
    for (const auto fluent : inert_) row[fluent] = 0.0;
    const int node = nodes();
    const int found = table_.find_or_add(
        digest_of_row(row, width_), node,
        [&](int other) { return std::equal(row, row + width_, state(other)); },
        [&](int other) { return digest_of_row(state(other), width_); });
    work_ += 384 + width_;
    if (found != node) {
        if (cost_[found] == std::numeric_limits<float>::infinity()) return false;
        if (reached(found)) return true;
        // The root does not lead there by the way that was known.
        parent_[found] = parent, action_[found] = action, known_[found] = 0, done_[found] = 0;
        open(found);
        return true;
    }
    for (int i = 0; i < width_; ++i) {
        if constexpr (sizeof(Number) == 1)
            states_.push_back(row[i] != 0.0);
        else
            states_.push_back(row[i]);
    }
    parent_.push_back(parent), action_.push_back(action), known_.push_back(0), done_.push_back(0);
    left_.push_back(kind_ == NOVEL ? costs_.lacking(row) : 0);
    cost_.push_back(kind_ != LAZY ? evaluate(row) : parent < 0 ? 0.0f : cost_[parent]);
    if (cost_[node] == std::numeric_limits<float>::infinity() && parent >= 0) return false;
    open(node);
    return true;
}

/// Appends a node to the queues.
template <class Number>
void Tree<Number>::open(int node) {
    constexpr int MOST = (1 << 20) - 1;
    const double key =
        kind_ == NOVEL ? (novelty(node) << 20) + std::min(left_[node], MOST) : cost_[node];
    all_.append(key, node);
    if (action_[node] >= 0 && helpful_[action_[node]]) helped_.append(cost_[node], node);
    if (kind_ != LAZY) improve(node);
}

/// Remembers the node of the least cost.
template <class Number>
void Tree<Number>::improve(int node) {
    if (cost_[node] >= least_) return;
    if (kind_ == LAZY && node != root_) helped_.turns -= BOOST;
    least_ = cost_[node];
    if (node != root_) best_ = node;
}

/// Removes and returns the next node to expand, of the queues in turn; -1 where none is left.
template <class Number>
int Tree<Number>::next() {
    for (;;) {
        if (all_.empty() && helped_.empty()) return -1;
        const bool helped = all_.empty() || (!helped_.empty() && helped_.turns < all_.turns);
        Queue* first = helped ? &helped_ : &all_;
        const int node = first->next();
        if (done_[node] || !reached(node)) continue;
        ++first->turns;
        return node;
    }
}

/// Returns the relaxed cost of a state [F].
template <class Number>
float Tree<Number>::evaluate(const double* row) {
    const auto cost = static_cast<float>(costs_.estimate(row).cost);
    work_ += costs_.updates();
    return std::max(cost, 0.0f);  // rounding may make it negative
}

/// Evaluates a node, and adds the nodes that it leads to; returns whether an edge reaches the goal.
template <class Number>
bool Tree<Number>::expand(int node) {
    done_[node] = 1;
    std::copy_n(state(node), width_, source_.begin());
    std::fill(helpful_.begin(), helpful_.end(), 0);
    float cost = evaluate(source_.data());
    work_ += 8 * model_.actions();
    const bool alive = cost < std::numeric_limits<float>::infinity();
    const auto plan = static_cast<float>(costs_.relaxed_plan(helpful_));
    if (alive && kind_ == LAZY) cost = plan;
    cost_[node] = cost;
    if (!alive && node != root_) return false;  // from the root every action is tried
    stepper_->from(source_.data());
    bool goes_on = false;
    for (int action = 0; action < model_.actions(); ++action) {
        const Flags flags = stepper_->step(action, target_.data());
        if (!(flags & APPLICABLE)) continue;
        work_ += 64 + width_ / 2;
        if (step_risk(flags, accepted_risk_) > 0.0) continue;
        if (!(flags & TERMINAL)) {
            goes_on |= add(target_.data(), node, action);
        } else if (target_[width_] > 0.0) {
            goal_ = best_ = node, last_ = action, least_ = 0.0, done_[node] = 0;
            return true;
        }
    }
    if (kind_ == LAZY && goes_on && alive) improve(node);
    if (!goes_on && node == best_) best_ = -1;
    return false;
}

/// Returns the novelty of a node, and remembers its values and pairs: 1 where a value is new among
/// the states that lack as many conditions of the goal, 2 where a pair of values is, else 3.
template <class Number>
int Tree<Number>::novelty(int node) {
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
    const bool pairs = std::int64_t{changed} * count <= MAX_PAIRS;
    work_ += 64 + 4 * (pairs ? changed * count : changed);
    bool single = false, pair = false;
    for (int k = 0; k < changed; ++k) single |= seen_->add(atoms_[k]);
    for (int k = 0; pairs && k < changed; ++k)
        for (int j = k + 1; j < count; ++j) {
            const auto [low, high] = std::minmax(atoms_[k], atoms_[j]);
            pair |= seen_->add(finished(mixed(low, high)));
        }
    return single ? 1 : pair ? 2 : 3;
}

template <class Number>
std::pair<std::int64_t, bool> Tree<Number>::search(const double* row, std::int64_t limit) {
    const std::int64_t most = std::min(
        MAX_BYTES / (NODE_BYTES + width_ * static_cast<std::int64_t>(sizeof(Number))),
        std::int64_t{std::numeric_limits<std::int32_t>::max()} / 2 - model_.actions() - 2);
    std::fill(helpful_.begin(), helpful_.end(), 0);
    work_ = 0;
    enter(row);
    goal_ = -1;
    while (work_ / WORK < limit) {
        const int node = next();
        if (node < 0) break;
        if (nodes() > most) {
            full_ = true;
            break;
        }
        if (expand(node)) return {work_ / WORK, true};
    }
    if (best_ < 0 || best_ == root_ || !reached(best_)) {  // on to the best that is open
        while ((best_ = all_.peek()) >= 0 && (done_[best_] || !reached(best_))) all_.next();
    }
    return {work_ / WORK, false};
}

template <class Number>
std::vector<double> Tree<Number>::way() const {
    std::vector<int> nodes;
    for (int node = goal_; node >= 0; node = node == root_ ? -1 : parent_[node])
        nodes.push_back(node);
    std::vector<double> states;
    for (auto at = nodes.rbegin(); at != nodes.rend(); ++at)
        states.insert(states.end(), state(*at), state(*at) + width_);
    return states;
}

template <class Number>
int Tree<Number>::toward(const double* row) {
    const int from = root_ < 0 ? -1 : find(row);
    if (from < 0 || !reached(from)) return -1;
    if (from == goal_) return last_;
    for (int node = best_; node >= 0 && node != root_; node = parent_[node])
        if (parent_[node] == from) return action_[node];
    return -1;
}

// For Python ---------------------------------------------------------------------------------------

std::unique_ptr<WaySearch> way_search(const Model& model, const Relaxation& relaxation,
                                      const In<std::int64_t, nb::ndim<1>>& inert, bool binary,
                                      double accepted_risk, std::int64_t kind) {
    if (kind < 0 || kind >= KINDS)
        throw std::invalid_argument("there is no search " + std::to_string(kind));
    if (relaxation.fluents() != model.fluents() || relaxation.last_action() >= model.actions())
        throw std::invalid_argument("model and relaxation differ in their fluents or actions");
    std::vector<std::int64_t> fluents = vector_of(inert);
    for (const auto fluent : fluents)
        if (fluent < 0 || fluent >= model.fluents())
            throw std::invalid_argument("there is no fluent " + std::to_string(fluent));
    if (binary)
        return std::make_unique<Tree<std::uint8_t>>(model, relaxation, std::move(fluents),
                                                    accepted_risk, static_cast<Kind>(kind));
    return std::make_unique<Tree<double>>(model, relaxation, std::move(fluents), accepted_risk,
                                          static_cast<Kind>(kind));
}

}  // namespace

void bind_relaxation(nb::module_& module);

void bind_goal_search(nb::module_& module) {
    bind_relaxation(module);
    using State = In<double, nb::ndim<1>>;
    nb::class_<WaySearch>(module, "WaySearch",
                          "A search for a way to the goal that can be gone on with.")
        .def(nb::new_(&way_search), nb::arg("model"), nb::arg("relaxation"), nb::arg("inert"),
             nb::arg("binary"), nb::arg("accepted_risk"), nb::arg("kind"),
             nb::keep_alive<0, 2>(), nb::keep_alive<0, 3>(),  // of __new__, whose first one is the class
             "Fluents `inert` become 0 in all states; `binary` says that all others are 0 or 1. The "
             "search is by novelty (`kind` 0), by relaxed cost (1), or lazy (2).")
        .def("search", [](WaySearch& self, const State& state, std::int64_t limit)
                -> std::pair<std::int64_t, std::optional<Array<double>>> {
                const auto [followed, found] = self.search(state_of(state, self.fluents()), limit);
                if (!found) return {followed, std::nullopt};
                std::vector<double> states = self.way();
                const std::size_t width = state.size();
                const std::size_t count = width ? states.size() / width : 1;
                return {followed, array_of(std::move(states), {count, width})};
            }, nb::arg("state"), nb::arg("limit"),
            "Search on from a state [F]. Return the edges that were followed, about `limit` at "
            "most, and the states [N, F] on the way but the last one; None where none was found.")
        .def("toward", [](WaySearch& self, const State& state) {
                return self.toward(state_of(state, self.fluents()));
            }, nb::arg("state"),
            "Return the action that leads from a state [F] to the least relaxed cost; -1: none.")
        .def_prop_ro("least", &WaySearch::least, "Least relaxed cost of all states of the tree.")
        .def_prop_ro("fresh", &WaySearch::fresh,
                     "Whether the last search began anew, not with the states of those before.");
}

}  // namespace serp
