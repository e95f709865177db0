// The search for a way to the goal; goal_search.py says how it goes.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/unique_ptr.h>

#include <algorithm>
#include <array>
#include <bit>
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
#include "serp/planning/graph.hpp"
#include "serp/planning/relaxation.hpp"

namespace serp {

namespace {

/// Most bytes of the nodes of a search.
constexpr std::int64_t SEARCH_BYTES = 150'000'000;
/// Bytes of a node beside its state.
constexpr std::int64_t NODE_BYTES = 128;
/// Most pairs of values of a state that are looked at.
constexpr int MAX_PAIRS = 20'000;
/// So many times a helpful action comes first after the least cost has become less, see LAMA.
constexpr std::int64_t BOOST = 1'000;
/// Most edges that are followed to leave out actions of a way.
constexpr std::int64_t ELIMINATION = 50'000;

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

/// How a search goes: by novelty; by relaxed cost; by the cost of the relaxed plan of the state
/// before, so that a state is evaluated when its turn comes (lazy greedy search: Richter & Westphal,
/// JAIR 2010); by that and by landmarks in turns; or breadth first to a state from which the actions
/// of a way lead to the goal, without those that are not applicable.
enum Kind : std::int64_t { NOVEL, GREEDY, LAZY, LANDMARKS, MEND, KINDS };

/// A search for a way to the goal that can be gone on with while the world follows it.
class WaySearch {
public:
    WaySearch(const Model& model, const Relaxation& relaxation, std::vector<std::int64_t> inert,
              std::vector<std::int64_t> numbers, double accepted_risk, Kind kind)
        : kind_(kind), model_(model), stepper_(model.stepper()), width_(model.fluents()),
          bits_((width_ + 63) / 64), size_(bits_ + numbers.size()), inert_(std::move(inert)),
          numbers_(std::move(numbers)), accepted_risk_(accepted_risk), costs_(relaxation),
          atoms_(width_ + numbers_.size()), helpful_(model.actions()), source_(width_),
          target_(width_ + 1), packed_(size_) {}

    /// Searches on from a state [F] for an edge that reaches the goal, and follows at most about
    /// `limit` edges, or does as much other work; returns how many, and whether the goal was reached.
    std::pair<std::int64_t, bool> search(const double* state, std::int64_t limit);
    /// Returns the states [N * F] on the way to the goal that was found, but the last one.
    std::vector<double> way() const;
    /// Returns the actions of that way.
    std::vector<std::int64_t> plan() const;
    /// Takes the actions of a way that was left; a std::invalid_argument says that one is not there.
    void mend(std::vector<std::int64_t> plan);
    /// Returns the action that leads from a state [F] to the goal, where a way was found, else to
    /// the state of the least cost that is known; -1 where there is none.
    int toward(const double* state);
    /// Returns the least cost of all states of the tree; infinite where the goal is out of reach.
    double least() const { return least_; }
    /// Returns whether the last search began anew: those before it make no difference.
    bool fresh() const { return fresh_; }
    int fluents() const { return width_; }

private:
    int nodes() const { return static_cast<int>(parent_.size()); }
    const Digest* state(int node) const { return states_.data() + node * size_; }
    bool is_state(int node) const {
        return std::equal(packed_.begin(), packed_.end(), state(node));
    }
    bool lazy() const { return kind_ == LAZY || kind_ == LANDMARKS; }
    void pack(const double* row);
    void unpack(int node, double* row) const;
    int find(const double* row);
    void enter(const double* row);
    bool add(double* row, int parent, int action);
    void open(int node);
    bool reached(int node);
    int next();
    float evaluate(const double* row);
    void improve(int node);
    bool expand(int node);
    int novelty(int node);
    bool applied(int node, const std::vector<std::int64_t>& plan, std::size_t without);
    bool follow(int node);
    void end_at(int node, int action) {
        goal_ = best_ = node, last_ = action, least_ = 0.0, done_[node] = 0;
    }
    int count_landmarks(const double* row, int parent);

    const Kind kind_;
    const Model& model_;
    const std::unique_ptr<Stepper> stepper_;
    int width_;
    std::size_t bits_, size_;           ///< words of a state: those with a bit of each fluent, and all
    std::vector<std::int64_t> inert_, numbers_;  ///< fluents that are 0; that are not 0 or 1
    double accepted_risk_;
    RelaxedCosts costs_;

    HashTable table_;                   ///< nodes by their states
    std::vector<Digest> states_;        ///< [N * size] see `pack`
    std::vector<std::int32_t> parent_;  ///< [N] node that each was reached from; -1 of the root
    std::vector<std::int32_t> action_;  ///< [N] by which action
    std::vector<std::int32_t> known_;   ///< [N] 2 x number of the root + whether it leads to the node
    std::vector<float> cost_;           ///< [N] relaxed cost of the node, or of its parent
    std::vector<std::int32_t> left_;    ///< [N] conditions of the goal, or landmarks, that it lacks
    std::vector<std::uint8_t> done_;    ///< [N] whether the node is expanded
    Landmarks landmarks_;               ///< of the first root
    std::size_t words_ = 0;
    std::vector<std::uint64_t> marks_;  ///< [N * words] bits of the landmarks that were true before
    /// Of all nodes, and of those that a helpful action leads to, by cost; then by landmarks.
    std::array<Queue, 4> queues_;
    std::optional<Seen> seen_;
    std::vector<std::int64_t> plan_, applied_;  ///< of a way that is mended; those that are applicable
    int root_ = -1, best_ = -1, goal_ = -1, last_ = -1;
    /// How many roots there were: a node that is the root again is another one.
    std::int32_t roots_ = 0;
    double least_ = std::numeric_limits<double>::infinity();
    std::int32_t least_left_ = 0;       ///< fewest landmarks that a node lacks
    std::int64_t work_ = 0;
    bool full_ = false, fresh_ = true;
    bool landmark_ = false;             ///< whether the newest node is the first with a landmark
    std::vector<Digest> atoms_;         ///< [F] scratch memory
    std::vector<std::uint8_t> helpful_; ///< [A] scratch memory
    std::vector<double> source_, target_;  ///< [F], [F + 1] scratch memory
    std::vector<Digest> packed_;        ///< [size] scratch memory
};

/// Packs a state: whether each fluent is not 0, then the bits of the numbers.
void WaySearch::pack(const double* row) {
    for (std::size_t word = 0; word < bits_; ++word) {
        const int from = static_cast<int>(64 * word), to = std::min(from + 64, width_);
        packed_[word] = 0;
        for (int i = from; i < to; ++i) packed_[word] |= Digest{row[i] != 0.0} << (i - from);
    }
    for (std::size_t k = 0; k < numbers_.size(); ++k) packed_[bits_ + k] = bits_of(row[numbers_[k]]);
}

void WaySearch::unpack(int node, double* row) const {
    const Digest* words = state(node);
    for (int i = 0; i < width_; ++i) row[i] = static_cast<double>(words[i / 64] >> (i % 64) & 1);
    for (std::size_t k = 0; k < numbers_.size(); ++k)
        row[numbers_[k]] = std::bit_cast<double>(words[bits_ + k]);
}

int WaySearch::find(const double* row) {
    std::vector<double> source(row, row + width_);
    for (const auto fluent : inert_) source[fluent] = 0.0;
    pack(source.data());
    return table_.find(digest_of_row(packed_.data(), size_),
                       [this](int other) { return is_state(other); });
}

/// Makes a state the root: what it does not lead to is left out from now on. A tree that does not
/// hold the state, or has no room left, begins anew.
void WaySearch::enter(const double* row) {
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
    left_.clear(), done_.clear(), marks_.clear();
    queues_.fill(Queue(kind_ == GREEDY));
    if (kind_ == LANDMARKS) landmarks_ = costs_.landmarks(row, work_);
    words_ = (landmarks_.facts.size() + 63) / 64;
    if (kind_ == NOVEL) seen_.emplace();
    root_ = 0, roots_ = 1, best_ = -1, goal_ = -1, full_ = false, fresh_ = true;
    least_ = std::numeric_limits<double>::infinity();
    least_left_ = std::numeric_limits<std::int32_t>::max();
    std::copy_n(row, width_, target_.begin());
    add(target_.data(), -1, -1);
}

/// Returns whether the root leads to a node.
bool WaySearch::reached(int node) {
    int at = node;
    while (at >= 0 && at != root_ && known_[at] / 2 != roots_) at = parent_[at];
    const int known = 2 * roots_ + (at == root_ || (at >= 0 && known_[at] % 2));
    for (int on = node; on != at; on = parent_[on]) known_[on] = known;
    return known % 2;
}

/// Adds a node with a state [F] if there is none; inert fluents become 0. Returns whether the node is
/// worth going to: not if it is known to be a dead end.
bool WaySearch::add(double* row, int parent, int action) {
    for (const auto fluent : inert_) row[fluent] = 0.0;
    const int node = nodes();
    pack(row);
    const int found = table_.find_or_add(
        digest_of_row(packed_.data(), size_), node,
        [this](int other) { return is_state(other); },
        [this](int other) { return digest_of_row(state(other), size_); });
    work_ += 384 + width_;
    if (found != node) {
        if (cost_[found] == std::numeric_limits<float>::infinity()) return false;
        if (reached(found)) return true;
        // The root does not lead there by the way that was known.
        parent_[found] = parent, action_[found] = action, known_[found] = 0, done_[found] = 0;
        landmark_ = false;
        open(found);
        return true;
    }
    states_.insert(states_.end(), packed_.begin(), packed_.end());
    parent_.push_back(parent), action_.push_back(action), known_.push_back(0), done_.push_back(0);
    left_.push_back(kind_ == NOVEL ? costs_.lacking(row) : count_landmarks(row, parent));
    if (lazy() || kind_ == MEND)
        cost_.push_back(parent < 0 ? 0.0f : cost_[parent] + (kind_ == MEND));
    else
        cost_.push_back(evaluate(row));
    if (cost_[node] == std::numeric_limits<float>::infinity() && parent >= 0) return false;
    open(node);
    return true;
}

/// Appends a node to the queues.
void WaySearch::open(int node) {
    constexpr int MOST = (1 << 20) - 1;
    const double key =
        kind_ == NOVEL ? (novelty(node) << 20) + std::min(left_[node], MOST) : cost_[node];
    queues_[0].append(key, node);
    const bool helped = action_[node] >= 0 && (helpful_[action_[node]] || landmark_);
    if (helped) queues_[1].append(cost_[node], node);
    if (words_) queues_[2].append(left_[node], node);
    if (words_ && helped) queues_[3].append(left_[node], node);
    if (!lazy()) improve(node);
}

/// Appends to `marks_` the landmarks that were true on the way to a new node, and returns how many
/// were not, or have to be true again (Richter & Westphal, JAIR 2010).
int WaySearch::count_landmarks(const double* row, int parent) {
    const int count = static_cast<int>(landmarks_.facts.size());
    if (!count) return 0;
    const int node = nodes() - 1;
    for (std::size_t word = 0; word < words_; ++word)
        marks_.push_back(parent < 0 ? 0 : marks_[parent * words_ + word]);
    landmark_ = false;
    int left = 0;
    for (int k = 0; k < count; ++k) {
        std::uint64_t& word = marks_[node * words_ + k / 64];
        const std::uint64_t bit = std::uint64_t{1} << (k % 64);
        if ((word & bit) && !landmarks_.lasting[k]) continue;
        const bool holds = costs_.holds(landmarks_.facts[k], row);
        left += !holds;
        landmark_ |= holds && !(word & bit);
        if (holds) word |= bit;
    }
    work_ += 4 * count;
    return left;
}

/// Remembers the node of the least cost.
void WaySearch::improve(int node) {
    const bool nearer = left_[node] < least_left_;
    least_left_ = std::min(least_left_, left_[node]);
    if (lazy() && node != root_ && (nearer || cost_[node] < least_))
        for (const int k : {1, 3}) queues_[k].turns -= BOOST;
    if (cost_[node] >= least_) return;
    least_ = cost_[node];
    if (node != root_) best_ = node;
}

/// Removes and returns the next node to expand, of the queues in turn; -1 where none is left.
int WaySearch::next() {
    for (;;) {
        Queue* first = nullptr;
        for (Queue& queue : queues_)
            if (!queue.empty() && (!first || queue.turns < first->turns)) first = &queue;
        if (!first) return -1;
        const int node = first->next();
        if (done_[node] || !reached(node)) continue;
        ++first->turns;
        return node;
    }
}

/// Returns the relaxed cost of a state [F].
float WaySearch::evaluate(const double* row) {
    const auto cost = static_cast<float>(costs_.estimate(row).cost);
    work_ += costs_.updates();
    return std::max(cost, 0.0f);  // rounding may make it negative
}

/// Evaluates a node, and adds the nodes that it leads to; returns whether an edge reaches the goal.
bool WaySearch::expand(int node) {
    done_[node] = 1;
    if (kind_ == MEND && follow(node)) return true;
    unpack(node, source_.data());
    std::fill(helpful_.begin(), helpful_.end(), 0);
    work_ += 8 * model_.actions();
    if (kind_ != MEND) {
        const float cost = evaluate(source_.data());
        const auto plan = static_cast<float>(costs_.relaxed_plan(helpful_));
        cost_[node] = lazy() && cost < std::numeric_limits<float>::infinity() ? plan : cost;
    }
    const bool alive = cost_[node] < std::numeric_limits<float>::infinity();
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
            end_at(node, action);
            return true;
        }
    }
    if (lazy() && goes_on && alive) improve(node);
    if (!goes_on && node == best_) best_ = -1;
    return false;
}

/// Returns whether actions lead from a node to the goal, one of them left out, and those that are not
/// applicable, or not safe; `applied_` becomes the others.
bool WaySearch::applied(int node, const std::vector<std::int64_t>& plan, std::size_t without) {
    unpack(node, source_.data());
    applied_.clear();
    for (std::size_t k = 0; k < plan.size(); ++k) {
        if (k == without) continue;
        stepper_->from(source_.data());
        const Flags flags = stepper_->step(static_cast<int>(plan[k]), target_.data());
        work_ += 64 + width_ / 2;
        if (!(flags & APPLICABLE) || step_risk(flags, accepted_risk_) > 0.0) continue;
        applied_.push_back(plan[k]);
        if (flags & TERMINAL) return target_[width_] > 0.0;
        std::copy_n(target_.begin(), width_, source_.begin());
    }
    return false;
}

/// Follows the kept actions from a node, without those that the goal does not need (action
/// elimination: Nakhost & Müller, ICAPS 2010); returns whether they lead to the goal.
bool WaySearch::follow(int node) {
    if (!applied(node, plan_, plan_.size())) return false;
    plan_ = applied_;
    const std::int64_t most = work_ + ELIMINATION * WORK;
    for (std::size_t k = 0; k + 1 < plan_.size() && work_ < most;)
        if (applied(node, plan_, k))
            plan_ = applied_;
        else
            ++k;
    for (const auto action : plan_) {
        unpack(node, source_.data());
        stepper_->from(source_.data());
        if (stepper_->step(static_cast<int>(action), target_.data()) & TERMINAL) {
            end_at(node, static_cast<int>(action));
            return true;
        }
        add(target_.data(), node, static_cast<int>(action));
        node = find(target_.data());
    }
    return false;
}

/// Returns the novelty of a node, and remembers its values and pairs: 1 where a value is new among
/// the states that lack as many conditions of the goal, 2 where a pair of values is, else 3.
int WaySearch::novelty(int node) {
    const int parent = parent_[node];
    const bool everything = parent < 0 || left_[parent] != left_[node];
    const Digest group = mixed(START, left_[node]);
    const Digest* row = state(node);
    const Digest* former = everything ? row : state(parent);
    int count = 0;
    auto remember = [&](bool changes) {
        for (std::size_t word = 0; word < bits_; ++word) {
            const Digest change = everything ? row[word] : row[word] ^ former[word];
            for (Digest of = changes ? change : row[word] & ~change; of; of &= of - 1) {
                const int bit = std::countr_zero(of);
                atoms_[count++] = finished(mixed(mixed(group, 64 * word + bit), row[word] >> bit & 1));
            }
        }
        for (std::size_t k = bits_; k < size_; ++k)
            if (row[k] != 0 && changes == (everything || row[k] != former[k]))
                atoms_[count++] = finished(mixed(mixed(group, 64 * k), row[k]));
    };
    remember(true);  // the values that changed come first
    const int changed = count;
    if (!everything) remember(false);
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

std::pair<std::int64_t, bool> WaySearch::search(const double* row, std::int64_t limit) {
    std::fill(helpful_.begin(), helpful_.end(), 0);
    work_ = 0;
    enter(row);
    const auto bytes = NODE_BYTES + static_cast<std::int64_t>(8 * (words_ + size_));
    const std::int64_t most = std::min(
        SEARCH_BYTES / bytes,
        std::int64_t{std::numeric_limits<std::int32_t>::max()} / 2 - model_.actions() - 2);
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
        Queue& all = queues_[0];
        while ((best_ = all.peek()) >= 0 && (done_[best_] || !reached(best_))) all.next();
    }
    return {work_ / WORK, false};
}

std::vector<double> WaySearch::way() const {
    std::vector<int> nodes;
    for (int node = goal_; node >= 0; node = node == root_ ? -1 : parent_[node])
        nodes.push_back(node);
    std::vector<double> states(nodes.size() * width_);
    for (std::size_t k = 0; k < nodes.size(); ++k)
        unpack(nodes[nodes.size() - 1 - k], states.data() + k * width_);
    return states;
}

std::vector<std::int64_t> WaySearch::plan() const {
    std::vector<std::int64_t> actions{last_};
    for (int node = goal_; node >= 0 && node != root_; node = parent_[node])
        actions.push_back(action_[node]);
    std::reverse(actions.begin(), actions.end());
    return actions;
}

void WaySearch::mend(std::vector<std::int64_t> plan) {
    for (const auto action : plan)
        if (action < 0 || action >= model_.actions())
            throw std::invalid_argument("there is no action " + std::to_string(action));
    plan_ = std::move(plan);
}

int WaySearch::toward(const double* row) {
    const int from = root_ < 0 ? -1 : find(row);
    if (from < 0 || !reached(from)) return -1;
    if (from == goal_) return last_;
    for (int node = best_; node >= 0 && node != root_; node = parent_[node])
        if (parent_[node] == from) return action_[node];
    return -1;
}

// For Python ---------------------------------------------------------------------------------------

std::unique_ptr<WaySearch> way_search(const Model& model, const Relaxation& relaxation,
                                      const In<std::int64_t, nb::ndim<1>>& inert,
                                      const In<std::int64_t, nb::ndim<1>>& numbers,
                                      double accepted_risk, std::int64_t kind) {
    if (kind < 0 || kind >= KINDS)
        throw std::invalid_argument("there is no search " + std::to_string(kind));
    if (relaxation.fluents() != model.fluents() || relaxation.last_action() >= model.actions())
        throw std::invalid_argument("model and relaxation differ in their fluents or actions");
    std::vector<std::int64_t> zero = vector_of(inert), kept = vector_of(numbers);
    for (const auto& fluents : {zero, kept})
        for (const auto fluent : fluents)
            if (fluent < 0 || fluent >= model.fluents())
                throw std::invalid_argument("there is no fluent " + std::to_string(fluent));
    return std::make_unique<WaySearch>(model, relaxation, std::move(zero), std::move(kept),
                                       accepted_risk, static_cast<Kind>(kind));
}

}  // namespace

void bind_relaxation(nb::module_& module);

void bind_goal_search(nb::module_& module) {
    bind_relaxation(module);
    using State = In<double, nb::ndim<1>>;
    nb::class_<WaySearch>(module, "WaySearch",
                          "A search for a way to the goal that can be gone on with.")
        .def(nb::new_(&way_search), nb::arg("model"), nb::arg("relaxation"), nb::arg("inert"),
             nb::arg("numbers"), nb::arg("accepted_risk"), nb::arg("kind"),
             nb::keep_alive<0, 2>(), nb::keep_alive<0, 3>(),  // of __new__, whose first one is the class
             "Fluents `inert` become 0 in all states; all others but `numbers` are 0 or 1. The "
             "search is by novelty (`kind` 0), relaxed cost (1), lazy (2), lazy and by landmarks (3), "
             "or mends a way (4).")
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
        .def("plan", [](const WaySearch& self) {
                std::vector<std::int64_t> actions = self.plan();
                const std::size_t length = actions.size();
                return array_of(std::move(actions), {length});
            }, "Return the actions [N] of the way that was found.")
        .def("mend", [](WaySearch& self, const In<std::int64_t, nb::ndim<1>>& plan) {
                self.mend(vector_of(plan));
            }, nb::arg("plan"), "Take the actions [N] of a way that was left.")
        .def("toward", [](WaySearch& self, const State& state) {
                return self.toward(state_of(state, self.fluents()));
            }, nb::arg("state"),
            "Return the action that leads from a state [F] to the least relaxed cost; -1: none.")
        .def_prop_ro("least", &WaySearch::least, "Least relaxed cost of all states of the tree.")
        .def_prop_ro("fresh", &WaySearch::fresh,
                     "Whether the last search began anew, not with the states of those before.");
}

}  // namespace serp
