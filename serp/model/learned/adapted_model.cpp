#include "serp/model/learned/adapted_model.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <numeric>
#include <set>
#include <stdexcept>
#include <tuple>
#include <utility>

#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include "serp/_util/arrays.hpp"
#include "serp/_util/checks.hpp"

namespace serp {

namespace {

bool finite(const double* values, int count) {
    return std::all_of(values, values + count, [](double value) { return std::isfinite(value); });
}

bool inside(const std::vector<int>& positions, int least, int size) {
    return std::all_of(positions.begin(), positions.end(),
                       [=](int position) { return least <= position && position < size; });
}

}  // namespace

bool ObservedStep::usable() const {
    if (over) return finite(state.data(), static_cast<int>(state.size()));
    const auto small = [](double number) { return std::abs(number) < HUGE_NUMBER; };
    return std::all_of(state.begin(), state.end(), small) &&
           std::all_of(next_state.begin(), next_state.end(), small);
}

AdaptedModel::AdaptedModel(std::shared_ptr<const WrittenModel> written, SameArguments others,
                           bool flagging, std::vector<std::vector<FeatureGroup>> groups,
                           std::shared_ptr<Regression> worth)
    : written_(std::move(written)), parameters_(written_->theta()), others_(std::move(others)),
      flagging_(flagging), groups_(std::move(groups)), worth_(std::move(worth)) {
    const auto count = static_cast<std::size_t>(actions());
    require(groups_.size() == count && others_.schemas >= 0 &&
                others_.action.size() == count * static_cast<std::size_t>(others_.schemas),
            "the number of actions does not fit the model");
    require(inside(others_.action, -1, actions()), "there is no such other action");
    require(!worth_ || (worth_->heads == actions() && worth_->depth == fluents() + 2 &&
                        worth_->count == 2),
            "the regression of reward and end has another shape");
    place_groups();
}

/// Checks the groups, and numbers those with features of their own.
void AdaptedModel::place_groups() {
    std::map<std::pair<const Regression*, std::vector<int>>, int> places;
    std::set<const GroupParameters*> known;
    for (std::vector<FeatureGroup>& of_action : groups_) {
        for (FeatureGroup& group : of_action) {
            GroupParameters& shared = *group.shared;
            require(inside(group.inputs, 0, fluents()) && inside(group.targets, 0, fluents()),
                    "inputs or targets are not fluents");
            const Regression* regression = shared.regression.get();
            if (regression != nullptr) {
                require(regression->depth == static_cast<int>(group.inputs.size()) &&
                            regression->count == static_cast<int>(group.targets.size()) &&
                            0 <= shared.head && shared.head < regression->heads,
                        "a regression is of another shape than its group");
            }
            if (known.insert(&shared).second) {
                require(!shared.owned, "a model has parameters of its own");
                shared.owned = true;
                shared_.push_back(group.shared);
                shared.inputs = group.inputs;
                shared.width = fluents();
                shared.schemas = others_.schemas;
            }
            require(shared.inputs.size() == group.inputs.size(),
                    "groups that share parameters differ in shape");
            const auto next = static_cast<int>(places.size());
            group.place = places.try_emplace({regression, group.inputs}, next).first->second;
        }
    }
    places_ = static_cast<int>(places.size());
}

bool AdaptedModel::branches() const {
    return written_->branches() || std::any_of(shared_.begin(), shared_.end(), [](const auto& shared) {
               return shared->counted();
           });
}

bool AdaptedModel::active() const {
    return revised_ || worth() || std::any_of(shared_.begin(), shared_.end(), [](const auto& shared) {
               return shared->counted() || shared->corrected();
           });
}

bool AdaptedModel::counted(int action) const {
    return std::any_of(groups_[action].begin(), groups_[action].end(),
                       [](const FeatureGroup& group) { return group.shared->counted(); });
}

bool AdaptedModel::corrected(int action) const {
    return std::any_of(groups_[action].begin(), groups_[action].end(),
                       [](const FeatureGroup& group) { return group.shared->corrected(); });
}

void AdaptedModel::adopt(const std::vector<double>& parameters) {
    require(parameters.size() == parameters_.size(), "the number of parameters is wrong");
    require(finite(parameters.data(), static_cast<int>(parameters.size())),
            "parameters must be finite numbers");
    revised_ = parameters != written_->theta();
    parameters_ = revised_ ? parameters : written_->theta();
    ++adoptions_;
}

namespace {

/// Chance of an end from which on one that is predicted without `AdaptedModel::worth` is certain.
constexpr double CERTAIN_END = 0.9;
const std::vector<int> REWARD_AND_END{0, 1};

/// What a regression says of a state, the same for all actions. Computed as far as it is asked for.
class Residual {
public:
    Residual(const Regression& regression, const std::vector<int>& inputs)
        : regression_(regression), inputs_(inputs), x_(regression.depth), u_(regression.depth),
          z_(Regression::FEATURES), waves_(regression.count * Regression::CHUNKS),
          leverages_(regression.heads) {}

    /// Starts anew, from a state [F] of a number of its own.
    void from(const double* state, std::int64_t number) {
        if (number == number_) return;
        number_ = number;
        for (std::size_t i = 0; i < inputs_.size(); ++i) x_[i] = state[inputs_[i]];
        regression_.normalise(x_.data(), u_.data());
        inside_ = true;
        for (std::size_t i = 0; i < inputs_.size(); ++i) {
            inside_ = inside_ && std::abs(u_[i]) <= Regression::RANGE;
        }
        chunks_ = waves_known_ = 0;
        std::fill(leverages_.begin(), leverages_.end(), -1.0);
    }

    /// Whether the state is within the range of the data.
    bool inside() const { return inside_; }

    /// Sets an input behind those of the state, on which random features do not depend.
    void set(int input, double x) {
        u_[input] = (x - regression_.centre[input]) * regression_.shrink[input];
    }

    double leverage(int head) {
        if (leverages_[head] == -1.0) {
            if (regression_.leverage_needs_features()) compute_features(1);
            leverages_[head] = regression_.leverage(head, u_.data(), z_.data(), room_);
        }
        return leverages_[head];
    }

    /// Adds the residual of a head to the targets in `out` [F].
    ///
    /// Beyond the range of the data, where these say less than the prior, the linear model replaces
    /// one with features, as in a Gaussian process whose mean is linear: waves say nothing of far
    /// away.
    void add(int head, const std::vector<int>& targets, double* out) {
        std::int64_t most = regression_.most();
        if (most > LINEAR && !inside_ && leverage(head) >= UNKNOWN) most = LINEAR;
        const int all = regression_.features() / Regression::SMOOTH;
        if (most > LINEAR) compute_waves(most == CURVED ? 1 : all);
        for (int t = 0; t < regression_.count; ++t) {
            const std::int64_t kind = std::min(regression_.predictors()[t], most);
            if (kind == FILE_ALONE) continue;
            double value = out[targets[t]];
            value += regression_.linear_of(head, kind, t, u_.data());
            const int chunks = kind == FULL ? all : kind == CURVED ? 1 : 0;
            const double* waves = waves_.data() + t * Regression::CHUNKS;
            for (int chunk = 0; chunk < chunks; ++chunk) value += waves[chunk];
            out[targets[t]] = value;
        }
    }

private:
    void compute_features(int chunks) {
        for (; chunks_ < chunks; ++chunks_) {
            regression_.features_of(u_.data(), chunks_, z_.data() + chunks_ * Regression::SMOOTH);
        }
    }

    void compute_waves(int chunks) {
        compute_features(chunks);
        for (; waves_known_ < chunks; ++waves_known_) {
            const double* z = z_.data() + waves_known_ * Regression::SMOOTH;
            for (int t = 0; t < regression_.count; ++t) {
                const std::int64_t kind = regression_.predictors()[t];
                if (kind == FULL || (kind == CURVED && waves_known_ == 0)) {
                    waves_[t * Regression::CHUNKS + waves_known_] =
                        regression_.wave_of(kind, t, waves_known_, z);
                }
            }
        }
    }

    const Regression& regression_;
    const std::vector<int>& inputs_;
    std::int64_t number_ = -1;
    std::vector<double> x_, u_, z_;  ///< inputs, normalised inputs, random features
    std::vector<double> waves_;      ///< [T, CHUNKS] what the features add
    std::vector<double> leverages_;  ///< [H], -1 where it is not known yet
    std::vector<double> room_;
    int chunks_ = 0, waves_known_ = 0;
    bool inside_ = false;
};

class AdaptedStepper : public Stepper {
public:
    explicit AdaptedStepper(const AdaptedModel& model)
        : model_(model), width_(model.fluents()), file_(model.file_step()),
          written_(model.written_step()), adoptions_(model.adoptions()), outcomes_(width_),
          flowed_(width_ + 1), usual_(width_ + 1), other_(width_ + 1), residuals_(model.places()),
          columns_(width_) {
        std::iota(columns_.begin(), columns_.end(), 0);
    }

    void from(const double* state) override {
        if (adoptions_ != model_.adoptions()) {
            adoptions_ = model_.adoptions();
            file_ = model_.file_step();
        }
        choose(0);  // another one is left where a step threw
        state_ = state;
        ++number_;
        file_.from(state);
        if (model_.revised()) written_.from(state);
    }

    /// Sets the outcome of the file that `unweighed` predicts from now on.
    void choose(int outcome) {
        file_.choose(outcome);
        written_.choose(outcome);
    }

    Flags step(int action, double* out) override {
        if (chance_ && file_.program().outcomes(action) > 1) {
            rows_.resize(OUTCOMES * (width_ + 3));
            const int count = chance_outcomes(action, rows_.data());
            const auto first = static_cast<Flags>(rows_[width_ + 1]);
            if (!(first & APPLICABLE)) return first;
            return joint(rows_.data(), count, width_, flagged_by_file(action), out);
        }
        const Flags flags = unweighed(action, out);
        if (!model_.worth() || !(flags & APPLICABLE) || (flags & UNSAFE)) return flags;
        const Worth worth = weigh(action, {out[width_], expected_end_});
        out[width_] = worth.reward;
        return worth.ends ? ending(flags, worth.end) : flags;
    }

    Steps steps(const double* states, int /*count*/) override {
        chances_.assign(model_.actions(), 0.0);
        doubted_.resize(chances_.size() * (width_ + 1));
        noting_ = true;
        Steps steps = each_step(states, model_.actions(), width_);
        noting_ = false;
        steps.chances = chances_.data(), steps.written = doubted_.data();
        return steps;
    }

    /// Predicts a step as `step` does, but does not correct reward and end.
    Flags unweighed(int action, double* out) {
        const bool revised = model_.revised(), known = revised || model_.flagging();
        const bool counted = model_.counted(action);
        if (!revised && !counted && !model_.corrected(action)) {
            const Flags flags = file_.step(action, out);
            expected_end_ = flags & TERMINAL ? 1.0 : 0.0;
            return flags;
        }
        // UNSAFE and UNDEFINED are set by the file as written. With its parameters, effects and
        // processes set the same flags in both steps, but events may not.
        Flags written = revised ? written_.step(action, other_.data()) : 0;
        Flags flags = file_.flow(action, out);
        if (known && !revised) {
            std::copy(out, out + width_ + 1, other_.data());
            written = flags & APPLICABLE ? file_.settle(flags, other_.data()) : flags;
        }
        if (written & UNDEFINED) return written;
        Flags flagged = written & UNSAFE;
        double risk = 0.0;
        if (flags & APPLICABLE) {
            correct(action, out);
            if (counted) {
                std::tie(flags, risk) = settle_outcomes(action, flags, out);
            } else {
                flags = file_.settle(flags, out);
                risk = flags & UNSAFE ? 1.0 : 0.0;
                expected_end_ = flags & TERMINAL ? 1.0 : 0.0;
            }
        }
        if (!known) flagged = flags & UNSAFE;
        flags = (flags & ~UNSAFE) | flagged;
        return (flags & APPLICABLE) && !flagged ? with_risk(flags, risk) : flags;
    }

    int outcomes(int action, double* rows) override {
        if (chance_ && file_.program().outcomes(action) > 1) return chance_outcomes(action, rows);
        const int count = chosen_outcomes(action, rows);
        if (count == 0) return only_outcome(action, rows, width_);
        if (model_.worth()) weigh_outcomes(action, rows, count);
        return count;
    }

private:
    /// Writes all outcomes that the file gives an action, each with those that are learned of it.
    int chance_outcomes(int action, double* rows) {
        const int row = width_ + 3, chances = file_.program().outcomes(action);
        std::vector<double> part(OUTCOMES * row);
        std::vector<std::vector<double>> all;
        for (int k = 0; k < chances; ++k) {
            choose(k);
            int count = chosen_outcomes(action, part.data());
            if (count == 0) {
                part[width_ + 1] = static_cast<double>(unweighed(action, part.data()));
                part[width_ + 2] = count = 1;
            }
            for (int j = 0; j < count; ++j) {
                const double* of = part.data() + j * row;
                all.emplace_back(of, of + row).back() *= file_.program().chance(action, k);
                if (static_cast<Flags>(of[width_ + 1]) & APPLICABLE) continue;
                choose(0);  // a step without a result must not count as safe
                std::copy_n(of, row, rows);
                rows[width_ + 2] = 1.0;
                return 1;
            }
        }
        choose(0);
        const auto likelier = [](const auto& one, const auto& other) {
            return one.back() > other.back();
        };
        std::stable_sort(all.begin(), all.end(), likelier);
        const int count = std::min(static_cast<int>(all.size()), OUTCOMES);
        const auto unsafe = [this](const auto& of) {
            return static_cast<Flags>(of[width_ + 1]) & UNSAFE;
        };
        // What is left out must not be what is unsafe: such an outcome replaces the last safe one.
        for (auto rest = all.begin() + count; rest != all.end(); ++rest) {
            if (!unsafe(*rest)) continue;
            int last = count - 1;
            while (last > 0 && unsafe(all[last])) --last;
            if (last > 0) std::swap(all[last], *rest);
        }
        double total = 0.0;
        for (int k = 0; k < count; ++k) total += all[k].back();
        for (int k = 0; k < count; ++k) {
            std::copy_n(all[k].data(), row, rows + k * row);
            rows[k * row + width_ + 2] /= total;
        }
        if (model_.worth()) weigh_outcomes(action, rows, count);
        return count;
    }

    /// Whether the file as written flags every outcome of an action.
    bool flagged_by_file(int action) {
        FileStep& file = model_.revised() ? written_ : file_;
        bool flagged = true;
        for (int k = 0; k < file.program().outcomes(action) && flagged; ++k) {
            choose(k);
            flagged = file.step(action, other_.data()) & UNSAFE;
        }
        choose(0);
        return flagged;
    }

    /// Writes what is learned of the outcomes of an action, as `outcomes` does, but for reward and
    /// end; 0 where the step of `unweighed` is the only one.
    int chosen_outcomes(int action, double* rows) {
        const int width = width_, row = width + 3;
        Flags before = 0;
        const int count = model_.counted(action) ? branch(action, rows, before) : 0;
        int kept = 0;
        double total = 0.0;
        for (int k = 0; k < count; ++k) {
            const double* source = rows + k * row;
            double* target = rows + kept * row;
            if (source[width + 2] < RARE) continue;
            if (source != target) std::copy_n(source, row, target);
            Flags flags = file_.settle(before, target);
            if (!(flags & APPLICABLE)) {
                std::copy_n(source, width + 1, target);
                flags = before & ~TERMINAL;
            }
            target[width + 1] = static_cast<double>(flags);
            total += target[width + 2];
            ++kept;
        }
        for (int k = 0; k < kept; ++k) rows[k * row + width + 2] /= total;
        return kept;  // 0: all are rare
    }

public:
    /// The largest leverage of what the file does not predict. The file predicts what has typical
    /// errors of at most half of the change.
    double uncertainty(int action) override {
        double unknown = 0.0;
        for (const FeatureGroup& group : model_.groups(action)) {
            const Regression* regression = group.shared->regression.get();
            if (regression != nullptr && !regression->file_suffices()) {
                unknown = std::max(unknown, residual(group).leverage(group.shared->head));
            }
        }
        return unknown;
    }

    /// The probability of an end in the newest step by `unweighed`, if that is applicable.
    double expected_end() const { return expected_end_; }

    /// Writes every outcome before events, as `outcomes` does, but flags are 0; `before` are the flags
    /// so far. Returns how many there are, 0 where there is no result.
    int branch(int action, double* rows, Flags& before) {
        before = file_.flow(action, rows);
        if (!(before & APPLICABLE)) return 0;
        correct(action, rows);
        if (!finite(rows, width_)) return 0;
        rows[width_ + 2] = 1.0;
        std::copy(rows, rows + width_, flowed_.data());
        int count = 1;
        for (const FeatureGroup& group : model_.groups(action)) {
            if (group.shared->counted()) count = split(group, action, rows, count);
        }
        return count;
    }

private:
    /// Reward and probability of an end; whether the latter is corrected.
    struct Worth {
        double reward, end;
        bool ends = false;
    };

    /// Corrects what is expected of a step. Beyond the range of the data, and after an action without
    /// errors, it is right as it is.
    Worth weigh(int action, Worth expected) {
        const Regression& regression = *model_.worth();
        if (!worth_) worth_ = std::make_unique<Residual>(regression, columns_);
        worth_->from(state_, number_);
        if (!worth_->inside()) return expected;
        worth_->set(width_, expected.reward);
        worth_->set(width_ + 1, expected.end);
        double change[2] = {0.0, 0.0};
        worth_->add(action, REWARD_AND_END, change);
        const double* typical = regression.typical.data() + 2 * action;
        Worth worth = expected;
        if (typical[0] > 0.0 && std::isfinite(worth.reward + change[0])) worth.reward += change[0];
        worth.ends = regression.predictors()[1] != FILE_ALONE && typical[1] > 0.0 &&
                     std::isfinite(change[1]);
        if (worth.ends) worth.end = std::clamp(worth.end + change[1], 0.0, 1.0);
        return worth;
    }

    /// Returns flags with a chance of an end; see `AdaptedModel`.
    Flags ending(Flags flags, double chance) const {
        if (!(flags & TERMINAL)) return with_end(flags, chance);
        const bool doubtful = chance < CERTAIN_END && model_.worth()->predictors()[0] != FILE_ALONE;
        return doubtful ? with_end(flags & ~TERMINAL, chance) : flags;
    }

    /// Corrects what is expected over some outcomes, in all of these that are not flagged unsafe:
    /// rewards by the same number, chances of an end by the same factor.
    void weigh_outcomes(int action, double* rows, int count) {
        const int row = width_ + 3;
        Worth expected{0.0, 0.0};
        for (double* of = rows; of != rows + count * row; of += row) {
            expected.reward += of[width_ + 2] * of[width_];
            if (static_cast<Flags>(of[width_ + 1]) & TERMINAL) expected.end += of[width_ + 2];
        }
        const Worth worth = weigh(action, expected);
        const double rest = std::max(0.0, 1.0 - expected.end);  // rounding may make it negative
        for (double* of = rows; of != rows + count * row; of += row) {
            const auto flags = static_cast<Flags>(of[width_ + 1]);
            if (flags & UNSAFE) continue;
            const double reward = of[width_] + (worth.reward - expected.reward);
            if (std::isfinite(reward)) of[width_] = reward;
            if (!worth.ends) continue;
            const double chance = flags & TERMINAL
                                      ? std::min(1.0, worth.end / expected.end)
                                      : std::max(0.0, 1.0 - (1.0 - worth.end) / rest);
            of[width_ + 1] = static_cast<double>(ending(flags, chance));
        }
    }

    Residual& residual(const FeatureGroup& group) {
        std::unique_ptr<Residual>& of = residuals_[group.place];
        if (!of) of = std::make_unique<Residual>(*group.shared->regression, group.inputs);
        of->from(state_, number_);
        return *of;
    }

    /// Adds the residual to what effects and processes gave; ignores it where the result is not
    /// finite.
    void correct(int action, double* out) {
        bool corrected = false;
        for (const FeatureGroup& group : model_.groups(action)) {
            if (group.shared->corrected()) {
                residual(group).add(group.shared->head, group.targets, out);
                corrected = true;
            }
        }
        if (corrected && !finite(out, width_)) file_.flow(action, out);
    }

    /// Applies the likeliest outcome of each group to `out` [F], the state after effects, processes
    /// and residual. Returns the number of groups with counts, and the outcome of the last of these.
    ///
    /// In `steps`, the file's probability and state [F] are noted where that is not what it says.
    std::pair<int, int> apply_likeliest(int action, Flags flow_flags, double* out) {
        int counted = 0, which = 0;
        double written = 1.0;
        bool doubted = false;
        std::copy(out, out + width_, flowed_.data());
        for (const FeatureGroup& group : model_.groups(action)) {
            if (!group.shared->counted()) continue;
            ++counted;
            which = likeliest(group, action);
            written *= outcomes_.probabilities[0];
            if (which > 0) {
                group.shared->outcomes->put(which, group.inputs, outcomes_, out);
                doubted = true;
            }
        }
        if (noting_ && doubted && written >= RARE) {
            double* of = doubted_.data() + action * std::ptrdiff_t{width_ + 1};
            std::copy_n(flowed_.data(), width_, of);
            const Flags flags = file_.settle(flow_flags, of);
            const bool on = (flags & (APPLICABLE | TERMINAL | UNSAFE)) == APPLICABLE;
            chances_[action] = on ? written : 0.0;
        }
        return {counted, which};
    }

    int likeliest(const FeatureGroup& group, int action) {
        const OutcomeStep step{file_, action, group.inputs, state_, flowed_.data()};
        return group.shared->outcomes->likeliest(step, outcomes_);
    }

    /// Applies the likeliest outcomes and then events; the reward is expected over all outcomes.
    ///
    /// Likewise the end. Groups are varied one at a time: their outcomes are assumed to be
    /// independent. Returns flags
    /// of the likeliest outcome, and the probability that events flag the step unsafe.
    std::pair<Flags, double> settle_outcomes(int action, Flags flow_flags, double* out) {
        const auto [counted, last] = apply_likeliest(action, flow_flags, out);
        std::copy(out, out + width_ + 1, usual_.data());
        const Flags flags = file_.settle(flow_flags, out);
        const bool unsafe = flags & UNSAFE;
        if (!(flags & APPLICABLE)) return {flags, unsafe ? 1.0 : 0.0};
        const double reward = out[width_];
        Worth expected{reward, flags & TERMINAL ? 1.0 : 0.0};
        const Worth usual = expected;
        double alike = 1.0;
        for (const FeatureGroup& group : model_.groups(action)) {
            if (!group.shared->counted()) continue;
            // What the room holds is its own, if no other group has counts.
            const int most = counted > 1 ? likeliest(group, action) : last;
            alike *= std::max(0.0, 1.0 - vary(group, most, flow_flags, unsafe, usual, expected));
        }
        if (std::isfinite(expected.reward)) out[width_] = expected.reward;
        expected_end_ = std::clamp(expected.end, 0.0, 1.0);
        return {flags, unsafe ? alike : 1.0 - alike};
    }

    /// Adds what other outcomes of a group change in the expected reward and end; returns the
    /// probability that events flag them differently.
    double vary(const FeatureGroup& group, int most, Flags flow_flags, bool unsafe, Worth usual,
                Worth& expected) {
        const OutcomeTable& table = *group.shared->outcomes;
        double different = 0.0;
        for (int kind = 0; kind < table.kinds; ++kind) {
            const double p = outcomes_.probabilities[kind];
            if (kind == most || p <= 0.0) continue;
            std::copy(usual_.begin(), usual_.end(), other_.begin());
            table.put(kind, group.inputs, outcomes_, other_.data());
            const Flags changed = file_.settle(flow_flags, other_.data());
            const bool undefined = changed & UNDEFINED, flagged = changed & UNSAFE;
            if (flagged != unsafe && (flagged || !undefined)) different += p;
            if (!undefined && std::isfinite(other_[width_])) {
                expected.reward += p * (other_[width_] - usual.reward);
                expected.end += p * ((changed & TERMINAL ? 1.0 : 0.0) - usual.end);
            }
        }
        return different;
    }

    /// Splits every outcome so far by the counted outcomes of a group; returns their number.
    int split(const FeatureGroup& group, int action, double* rows, int count) {
        const OutcomeTable& table = *group.shared->outcomes;
        const int best = likeliest(group, action);
        const int width = width_, row = width + 3, before = count;
        for (int source = 0; source < before; ++source) {
            double* old = rows + source * row;
            const double left = old[width + 2];
            if (count + table.kinds - 1 > OUTCOMES) {  // no room: the likeliest one alone
                table.put(best, group.inputs, outcomes_, old);
                continue;
            }
            for (int kind = 1; kind < table.kinds; ++kind) {
                const double chance = left * outcomes_.probabilities[kind];
                if (chance < RARE) continue;
                double* created = rows + count * row;
                std::copy(old, old + row, created);
                table.put(kind, group.inputs, outcomes_, created);
                created[width + 2] = chance;
                ++count;
            }
            old[width + 2] = left * outcomes_.probabilities[0];
        }
        return count;
    }

    const AdaptedModel& model_;
    const int width_;
    FileStep file_, written_;
    int adoptions_;
    OutcomeRoom outcomes_;
    /// [F + 1] after effects, processes and residual; the same with the likeliest outcomes; scratch.
    std::vector<double> flowed_, usual_, other_;
    std::vector<double> rows_;  ///< outcomes of an action with chance
    std::vector<double> chances_, doubted_;  ///< of the newest `steps`, see `Steps`
    bool noting_ = false;                    ///< whether they are wanted: single steps need neither
    const bool chance_ = file_.program().branches();
    std::vector<std::unique_ptr<Residual>> residuals_;  ///< by `FeatureGroup::place`
    std::vector<int> columns_;                          ///< [F] of all fluents
    std::unique_ptr<Residual> worth_;
    double expected_end_ = 0.0;
    const double* state_ = nullptr;
    std::int64_t number_ = 0;  ///< of the state
};

}  // namespace

std::unique_ptr<Stepper> AdaptedModel::stepper() const {
    return std::make_unique<AdaptedStepper>(*this);
}

void AdaptedModel::weigh(ObservedStep& step) const {
    if (!worth_) return;
    if (!observer_) observer_ = stepper();
    auto& stepper = static_cast<AdaptedStepper&>(*observer_);
    std::vector<double> out(fluents() + 1);
    stepper.from(step.state.data());
    stepper.choose(step.file.chosen());
    const Flags flags = stepper.unweighed(step.action, out.data());
    stepper.choose(0);
    step.expected_reward = out.back();
    step.expected_end = stepper.expected_end();
    step.weighed = (flags & APPLICABLE) && !(flags & UNSAFE);
}

// For Python ---------------------------------------------------------------------------------------

namespace {

using State = In<double, nb::ndim<1>>;
/// Inputs, targets and shared part of a feature group.
using Group = std::tuple<std::vector<int>, std::vector<int>, std::shared_ptr<GroupParameters>>;

void set_outcomes(GroupParameters& of, std::shared_ptr<OutcomeTable> table) {
    if (table) table->check(of.inputs, of.width, of.schemas);
    of.outcomes = std::move(table);
}

std::shared_ptr<AdaptedModel> model_of(std::shared_ptr<WrittenModel> written,
                                       const In<std::int64_t, nb::ndim<2>>& others, bool flagging,
                                       std::vector<std::vector<Group>> groups,
                                       std::shared_ptr<Regression> worth) {
    SameArguments same;
    same.schemas = static_cast<int>(others.shape(1));
    for (std::size_t k = 0; k < others.size(); ++k) {
        require(std::in_range<int>(others.data()[k]), "there is no such other action");
        same.action.push_back(static_cast<int>(others.data()[k]));
    }
    std::vector<std::vector<FeatureGroup>> of_actions;
    for (std::vector<Group>& of_action : groups) {
        std::vector<FeatureGroup>& made = of_actions.emplace_back();
        for (auto& [inputs, targets, shared] : of_action) {
            require(shared != nullptr, "a group has no parameters");
            made.push_back({std::move(inputs), std::move(targets), std::move(shared)});
        }
    }
    return std::make_shared<AdaptedModel>(std::move(written), std::move(same), flagging,
                                          std::move(of_actions), std::move(worth));
}

const double* checked(const AdaptedModel& model, const State& state, std::int64_t action) {
    require(state.size() == static_cast<std::size_t>(model.fluents()),
            "a state must have a number for each fluent");
    require(0 <= action && action < model.actions(), "there is no such action");
    return state.data();
}

Array<double> branches_of(const AdaptedModel& model, const State& state, std::int64_t action) {
    const std::size_t row = static_cast<std::size_t>(model.fluents()) + 3;
    std::vector<double> rows(OUTCOMES * row, 0.0);
    AdaptedStepper stepper(model);
    stepper.from(checked(model, state, action));
    Flags before = 0;
    const auto count = static_cast<std::size_t>(
        stepper.branch(static_cast<int>(action), rows.data(), before));
    rows.resize(count * row);
    return array_of(std::move(rows), {count, row});
}

/// Returns null where the action is not applicable by the file.
std::unique_ptr<ObservedStep> observe(const AdaptedModel& model, const State& state,
                                      std::int64_t action, const State& next_state, bool over,
                                      double reward) {
    const double* from = checked(model, state, action);
    checked(model, next_state, action);
    auto step = std::make_unique<ObservedStep>(
        ObservedStep{model.file_step(), static_cast<int>(action), over, reward, vector_of(state),
                     vector_of(next_state), std::vector<double>(model.fluents() + 1)});
    step->file.from(from);
    step->file.choose(model.written().likeliest_outcome(from, step->action, next_state.data()));
    step->flags = step->file.flow(step->action, step->flowed.data());
    if (!(step->flags & APPLICABLE)) return nullptr;
    step->settled = step->flowed;
    step->file.settle(step->flags, step->settled.data());
    model.weigh(*step);
    return step;
}

/// Notes in `whole` [F] which numbers are not whole; returns whether there are new ones.
bool note_fractions(const ObservedStep& step, const Out<bool, nb::ndim<1>>& whole,
                const In<bool, nb::ndim<1>>& numeric) {
    require(whole.size() == step.state.size() && numeric.size() == whole.size(),
            "there must be one truth for each fluent");
    bool found = false;
    for (std::size_t i = 0; i < whole.size(); ++i) {
        const double number = step.next_state[i];
        if (whole.data()[i] && numeric.data()[i] && !(number == std::floor(number))) {
            whole.data()[i] = false;
            found = true;
        }
    }
    return found;
}

bool predicted(const ObservedStep& step, const In<std::int64_t, nb::ndim<1>>& columns) {
    for (std::size_t k = 0; k < columns.size(); ++k) {
        const std::int64_t column = columns.data()[k];
        require(0 <= column && column < std::ssize(step.state), "there is no such fluent");
        if (!(step.next_state[column] == step.settled[column])) return false;
    }
    return true;
}

}  // namespace

void bind_adapted_model(nb::module_& module) {
    nb::class_<GroupParameters>(module, "GroupParameters",
                                "What is learned of the feature groups of one key.")
        .def(nb::new_([](std::shared_ptr<Regression> regression, int head) {
                 return std::make_shared<GroupParameters>(std::move(regression), head);
             }), nb::arg("regression").none(), nb::arg("head"),
             "`regression`: that of the residual; None where there are too many inputs to learn.")
        .def_ro("head", &GroupParameters::head, "The head of the action schema in the regression.")
        .def_prop_rw("outcomes", [](const GroupParameters& of) { return of.outcomes; },
                     &set_outcomes, nb::arg("table").none(),
                     nb::for_getter(nb::sig("def outcomes(self) -> OutcomeTable | None")),
                     nb::for_setter(nb::sig("def outcomes(self, table: OutcomeTable | None) -> None")),
                     "The counts in use, or None. A ValueError says that they do not fit.");

    nb::class_<ObservedStep>(module, "ObservedStep",
                             "An observed transition, beside what the file says of it.")
        .def_ro("over", &ObservedStep::over, "Whether it ended the episode.")
        .def_prop_ro("usable", &ObservedStep::usable,
                     "Whether its numbers are small enough to learn from.")
        .def("note_fractions", &note_fractions, nb::arg("whole").noconvert(), nb::arg("numeric"),
             "Note in `whole` `[F]` which numbers are not whole; return whether there are new ones.")
        .def("predicted", &predicted, nb::arg("columns"),
             "Return whether the file predicted these fluents of the next state.");

    nb::class_<AdaptedModel, Model>(module, "AdaptedModel",
                                    "A model that is adapted to observed transitions.")
        .def(nb::new_(&model_of), nb::arg("written"), nb::arg("others"), nb::arg("flagging"),
             nb::arg("groups"), nb::arg("worth").none() = nb::none(),
             "`others` `[A, S]` is that of `same_arguments`; `groups` are inputs, targets and "
             "parameters of the feature groups of every ground action.")
        .def_prop_ro("active", &AdaptedModel::active, "Whether anything adapted is in use.")
        .def_prop_ro(
            "parameters",
            [](const AdaptedModel& model) {
                return array_of(std::vector<double>(model.parameters()),
                                {model.parameters().size()});
            },
            nb::rv_policy::move, "A copy of the parameters in use `[P]`.")
        .def("adopt", [](AdaptedModel& model, const State& parameters) {
                model.adopt(vector_of(parameters));
            }, nb::arg("parameters"), "Use parameters `[P]` from now on.")
        .def("observe", &observe, nb::arg("state"), nb::arg("action"), nb::arg("next_state"),
             nb::arg("over"), nb::arg("reward") = NAN, nb::keep_alive<0, 1>(),
             nb::sig("def observe(self, state: numpy.typing.NDArray[numpy.float64], action: int, "
                     "next_state: numpy.typing.NDArray[numpy.float64], over: bool, "
                     "reward: float = ...) -> "
                     "ObservedStep | None"),
             "Return an observed transition to learn from; None if the action is not applicable by "
             "the file. `over` says whether it ended the episode; a `reward` of NaN is not learned.")
        .def("branches_of", &branches_of, nb::arg("state"), nb::arg("action"),
             "Return all outcomes before events: state, reward, 0 and probability `[n, F + 3]`.");
}

}  // namespace serp
