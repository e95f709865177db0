// The samples of a regression, and which of its predictors has been best; both as Python sees them.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>

#include <nanobind/stl/shared_ptr.h>

#include "serp/_util/arrays.hpp"
#include "serp/_util/checks.hpp"
#include "serp/model/learned/adapted_model.hpp"
#include "serp/model/learned/regression.hpp"

namespace serp {

namespace {

/// Samples before which nothing counts as an outlier, and before which only extreme inputs do.
constexpr double FEW = 5.0, SETTLED = 30.0;
/// Weight of the past in the losses, per step.
constexpr double MEMORY = 0.999;
/// Errors of more standard deviations weigh less, as under Student's t: by their square (Lange,
/// Little & Taylor, Journal of the American Statistical Association 84, 1989).
constexpr double ROBUST = 5.0;
/// A surprise is such an error of more than the first fraction of the change. The world may have
/// changed if the last fraction of recent steps are surprises.
constexpr double NOTICED = 0.1, RECENT = 0.85, LASTING = 0.7;
/// Fraction of the error of another predictor below which one replaces it.
constexpr double BETTER = 0.95;
constexpr int PREDICTORS = FULL + 1;
/// Samples before which reward and end are not corrected: ends are rare.
constexpr double ENOUGH = 100.0;
/// Limits between the predicted chances of an end that are compared with how often it came.
constexpr double LIMITS[] = {0.05, 0.2, 0.5, 0.8};
/// An input is an outlier so many half ranges from the middle of its range.
constexpr double FAR = 8.0, EXTREME = 100.0;
/// After more successive outliers the environment is assumed to have changed.
constexpr std::int64_t PATIENCE = 3;
/// A change is lasting if it goes on in the next episode, or for so many steps: not an impact, nor
/// what a robot meets at the end of an episode only.
constexpr std::int64_t LONG = 24;
/// Weights are solved after every 30th part of the samples, or later where it takes long: after as
/// many samples as this cost goes into the cube of the columns, but after a quarter of the samples.
constexpr double EARLY = 4.0, LATER = 30.0, COST = 1e6;

/// What is due after a sample, see `RegressionSamples::learn`.
enum Due : int { NOTHING, FIT, FORGET };

/// The newest samples of a regression, the ranges of their inputs, and the errors of all predictors,
/// each before the sample was learned from. Weights are fitted elsewhere.
class RegressionSamples {
public:
    /// Most samples that are kept, and most that wait for being added to the sums.
    static constexpr std::int64_t KEPT = 4096, PENDING = 32;
    /// Newest samples that are believed after a lasting change.
    static constexpr std::int64_t REMEMBERED = 8;

    /// `squared`: errors of predictors are squared and none is an outlier, for what is rare.
    RegressionSamples(std::shared_ptr<Regression> regression, bool squared)
        : loss(PREDICTORS, regression->count), doubt(PREDICTORS, regression->count),
          seen(regression->count), spread(regression->count),
          samples(regression->heads, regression->count), surprises(1),
          reliability(std::size(LIMITS) + 1, 3), low(regression->depth), high(regression->depth),
          x(KEPT, regression->depth), y(KEPT, regression->count), weight(KEPT),
          valid(KEPT, regression->count), head(KEPT), block_of(regression->count),
          regression_(std::move(regression)), squared_(squared), x_(low.size()),
          y_(seen.size()), change_(seen.size()), valid_(seen.size()), whole_(seen.size()) {
        low.fill(std::numeric_limits<double>::infinity());
        high.fill(-std::numeric_limits<double>::infinity());
    }

    void clear_errors() {
        for (Block<double>* block :
             {&loss, &doubt, &seen, &spread, &samples, &surprises, &reliability}) {
            block->fill(0.0);
        }
    }

    Due learn(int head, const ObservedStep& step, const std::int64_t* inputs,
              const std::int64_t* targets, const bool* whole);
    Due learn_worth(int head, const ObservedStep& step, bool rewarded);
    void choose();
    bool solution_due() const;
    void normalise() const;

    const Regression& regression() const { return *regression_; }

    Block<double> loss;       ///< [4, T] moving averages of errors by predictor
    /// [4, T] moving averages of the squared differences between errors and those of the file
    Block<double> doubt;
    Block<double> seen;       ///< [T] samples in them
    Block<double> spread;     ///< [T] mean change
    Block<double> samples;    ///< [H, T] samples of each head
    Block<double> surprises;  ///< [1] fraction of surprises
    /// [5, 3] by corrected chance of an end: steps, sum of these chances, ends that came.
    Block<double> reliability;
    Block<double> low, high;  ///< [d] ends of the ranges of inputs; infinite at first
    /// A ring of the newest samples: inputs [KEPT, d], errors of the file [KEPT, T] and weights
    /// [KEPT], whether the errors are observed [KEPT, T], and heads [KEPT]. Sample k is in row
    /// k % KEPT.
    Block<double> x, y, weight;
    Block<std::uint8_t> valid;
    Block<std::int64_t> head;
    Block<std::int64_t> block_of;  ///< [T] which matrix of sums each target is in: 0 or 1
    std::int64_t number = 0;        ///< of samples ever kept
    std::int64_t start = 0;         ///< number of samples before the present world
    std::int64_t pending = 0;       ///< newest samples that are not in the sums
    std::int64_t since_solved = 0;  ///< samples since weights were solved
    std::int64_t outliers = 0;      ///< successive ones
    std::int64_t alarms = 0;        ///< successive samples by which the world may have changed
    std::int64_t of_episode = REMEMBERED;  ///< samples since the episode began

private:
    void centre_and_half(double* centre, double* half) const;
    bool accept();
    void keep(int of_head, double its_weight);
    Due take(int head, bool moved);
    std::pair<double, bool> account(int head);
    double predict(int head);
    void update(int head, int t, double weight, double share, double change);

    std::shared_ptr<Regression> regression_;
    const bool squared_;
    /// The new sample: inputs [d], observed next values less those of effects and processes [T],
    /// the observed change [T], whether the values are observed, and whether the file predicts them
    /// because they have always been whole numbers.
    std::vector<double> x_, y_, change_;
    std::vector<std::uint8_t> valid_, whole_;
    std::vector<double> errors_, u_, z_, room_;
};

/// Writes the centres of the ranges [d] and half their widths [d], 1 for what never changed.
void RegressionSamples::centre_and_half(double* centre, double* half) const {
    for (std::size_t i = 0; i < low.size(); ++i) {
        centre[i] = (high[i] + low[i]) / 2.0;
        half[i] = (high[i] - low[i]) / 2.0;
        if (half[i] <= 1e-9 * std::max(1.0, std::abs(centre[i]))) half[i] = 1.0;
    }
}

/// Widens the ranges to the inputs, or returns false for an outlier. After several outliers in a row
/// they are accepted.
bool RegressionSamples::accept() {
    const auto depth = low.size();
    bool far = false;
    if (static_cast<double>(number) >= FEW) {
        room_.resize(2 * depth);
        double *centre = room_.data(), *half = centre + depth;
        centre_and_half(centre, half);
        const double limit = static_cast<double>(number) >= SETTLED ? FAR : EXTREME;
        for (std::size_t i = 0; i < depth; ++i) {
            far = far || std::abs(x_[i] - centre[i]) > limit * half[i];
        }
    }
    outliers = far ? outliers + 1 : 0;
    if (0 < outliers && outliers <= PATIENCE) return false;
    for (std::size_t i = 0; i < depth; ++i) {
        low[i] = std::min(low[i], x_[i]);
        high[i] = std::max(high[i], x_[i]);
    }
    return true;
}

/// Normalises the inputs of the regression by their ranges.
void RegressionSamples::normalise() const {
    Regression& of = *regression_;
    centre_and_half(of.centre.data(), of.shrink.data());
    for (double& shrink : of.shrink) shrink = 1.0 / shrink;
}

/// Puts the new sample into the ring, in the place of the oldest one if it is full.
void RegressionSamples::keep(int of_head, double its_weight) {
    const auto row = static_cast<std::size_t>(number % KEPT);
    const auto put = [row](auto& ring, const auto& values) {
        std::copy(values.begin(), values.end(), ring.data() + row * values.size());
    };
    put(x, x_);
    put(y, y_);
    put(valid, valid_);
    head[row] = of_head;
    weight[row] = its_weight;
    ++number;
    ++pending;
    ++since_solved;
}

bool RegressionSamples::solution_due() const {
    const std::int64_t last = *std::max_element(block_of.begin(), block_of.end());
    const double size = regression_->columns + regression_->features();
    const double cost = static_cast<double>(1 + last) * (size * size * size) / COST;
    const auto recent = static_cast<double>(number - start);
    return static_cast<double>(since_solved) >=
           std::max(recent / LATER, std::min(recent / EARLY, cost));
}

/// Learns from a step of a ground action: columns of inputs [d] and targets [T] in its states, and
/// which fluents [F] have always been whole numbers, which a residual does not predict.
///
/// Returns what is due, after which `choose` must be called: FIT is an update of sums or weights,
/// FORGET the same after a lasting change of the world.
Due RegressionSamples::learn(int head, const ObservedStep& step, const std::int64_t* inputs,
                   const std::int64_t* targets, const bool* whole) {
    for (std::size_t i = 0; i < x_.size(); ++i) x_[i] = step.state[inputs[i]];
    bool any = false, moved = false;
    for (std::size_t t = 0; t < y_.size(); ++t) {
        const std::int64_t column = targets[t];
        y_[t] = step.next_state[column] - step.flowed[column];
        change_[t] = step.next_state[column] - step.state[column];
        // Where an event changes a fluent, the result of effects and processes is not observed.
        valid_[t] = step.flowed[column] == step.settled[column] && std::abs(y_[t]) < HUGE_NUMBER;
        whole_[t] = whole[column];
        any = any || valid_[t];
        moved = moved || (!valid_[t] && block_of[t] == 0);
    }
    if (!any || !accept()) return NOTHING;
    const Due due = take(head, moved);
    if (due == NOTHING) choose();
    return due;
}

/// Learns reward and end of a step, beside what the model predicts of them without this regression.
/// Like `learn`; `rewarded`: whether the reward is to be learned.
Due RegressionSamples::learn_worth(int head, const ObservedStep& step, bool rewarded) {
    // Their fourth powers have to be finite.
    constexpr double most = std::numeric_limits<float>::max();
    if (!step.weighed || !(std::abs(step.expected_reward) <= most)) return NOTHING;
    const double expected[2] = {step.expected_reward, step.expected_end};
    const double seen[2] = {step.reward, step.over ? 1.0 : 0.0};
    std::copy(step.state.begin(), step.state.end(), x_.begin());
    std::copy(expected, expected + 2, x_.end() - 2);
    bool moved = false;
    for (int t = 0; t < 2; ++t) {
        y_[t] = seen[t] - expected[t];
        change_[t] = seen[t];
        valid_[t] = (t > 0 || rewarded) && std::abs(y_[t]) < HUGE_NUMBER;
        moved = moved || (!valid_[t] && block_of[t] == 0);
    }
    if (!accept()) return NOTHING;
    const Due due = take(head, moved);
    if (const std::int64_t kind = regression_->predictors()[1]; kind != FILE_ALONE) {
        const double chance = std::clamp(seen[1] - errors_[2 * kind + 1], 0.0, 1.0);
        const auto place = std::upper_bound(std::begin(LIMITS), std::end(LIMITS), chance);
        double* of = reliability.data() + 3 * (place - std::begin(LIMITS));
        of[0] += 1.0, of[1] += chance, of[2] += seen[1];
    }
    if (due == NOTHING) choose();
    return due;
}

/// Adds the new sample.
Due RegressionSamples::take(int head, bool moved) {
    const auto [weight, changed] = account(head);
    keep(head, weight);
    ++of_episode;
    alarms = changed ? alarms + 1 : 0;
    if (changed && (of_episode < REMEMBERED || alarms > LONG)) return FORGET;
    return moved || pending >= PENDING || solution_due() ? FIT : NOTHING;
}

/// Writes the errors [4, T] of all predictors; returns the leverage.
double RegressionSamples::predict(int head) {
    const Regression& of = *regression_;
    const int count = of.count;
    errors_.resize(PREDICTORS * static_cast<std::size_t>(count));
    u_.resize(of.depth);
    z_.resize(Regression::SMOOTH);
    of.normalise(x_.data(), u_.data());
    for (int t = 0; t < count; ++t) {
        errors_[t] = y_[t];
        for (int kind = LINEAR; kind <= FULL; ++kind) {
            errors_[kind * count + t] = y_[t] - of.linear_of(head, kind, t, u_.data());
        }
    }
    if (of.features() == 0) return of.leverage(head, u_.data(), z_.data(), room_);
    double share = 1.0;
    for (int chunk = 0; chunk < of.features() / Regression::SMOOTH; ++chunk) {
        of.features_of(u_.data(), chunk, z_.data());
        for (int t = 0; t < count; ++t) {
            for (int kind = chunk > 0 ? FULL : CURVED; kind <= FULL; ++kind) {
                errors_[kind * count + t] -= of.wave_of(kind, t, chunk, z_.data());
            }
        }
        if (chunk == 0) share = of.leverage(head, u_.data(), z_.data(), room_);
    }
    return share;
}

/// Adds a sample to the losses. Returns its weight in the regression, and whether the world may have
/// changed.
std::pair<double, bool> RegressionSamples::account(int head) {
    const Regression& of = *regression_;
    const int count = of.count;
    const double share = predict(head);
    double worst = 0.0;
    bool surprise = false;
    for (int t = 0; t < count; ++t) {
        const double seen_of_head = samples[head * count + t];
        if (squared_ || !valid_[t] || !(seen_of_head >= FEW)) continue;
        const double error = errors_[of.predictors()[t] * count + t];
        const double least = 1e-9 * (1.0 + std::abs(y_[t] - error));
        const double typical = of.typical[head * count + t];
        const double variance =
            typical * typical + share * (of.scale[t] * of.scale[t]) + least * least;
        const double ratio = error * error / variance;
        worst = std::max(worst, ratio);
        if (ratio > ROBUST * ROBUST && std::abs(error) > NOTICED * spread[t]) {
            surprise = surprise || seen_of_head >= SETTLED;
        }
    }
    const double weight = worst <= ROBUST * ROBUST ? 1.0 : ROBUST * ROBUST / worst;
    surprises[0] = RECENT * surprises[0] + (surprise ? 1.0 - RECENT : 0.0);
    for (int t = 0; t < count; ++t) {
        if (valid_[t]) update(head, t, weight, share, change_[t]);
    }
    return {weight, surprise && surprises[0] > LASTING};
}

void RegressionSamples::update(int head, int t, double weight, double share, double change) {
    Regression& of = *regression_;
    const int count = of.count;
    const double error = errors_[of.predictors()[t] * count + t], size = std::abs(error);
    double& of_head = samples[head * count + t];
    double& typical = of.typical[head * count + t];
    of_head += 1.0;
    if (of_head > SETTLED) {
        const double limited = std::min(size, 4.0 * typical + 1e-12);
        typical += 0.02 * weight * (limited - typical);
    } else {
        typical += (size * weight - typical) / of_head;
    }
    // Hardly any for far outliers. The n-th sample initially has the weight 3 / (2 + n).
    const double rate = std::max(1.0 - MEMORY, 3.0 / (3.0 + seen[t])) * weight;
    // Over all samples: where a robot keeps still, little changes, and noise is most of it.
    spread[t] += weight / (1.0 + seen[t]) * (std::abs(change) - spread[t]);
    seen[t] += 1.0;
    const double file = squared_ ? errors_[t] * errors_[t] : std::abs(errors_[t]);
    for (int kind = FILE_ALONE; kind <= FULL; ++kind) {
        const double miss = errors_[kind * count + t];
        double off = squared_ ? miss * miss : std::abs(miss);
        double& average = loss[kind * count + t];
        if (kind != FILE_ALONE && seen[t] <= FEW) {
            off = std::min(off, file);
            if (seen[t] == 2.0) {
                average = off;
                continue;
            }
        }
        average += rate * (off - average);
        const double beside = off - file;
        double& mean_square = doubt[kind * count + t];
        mean_square += rate * (beside * beside - mean_square);
    }
    // The error where nothing is known, as far as it was seen: at first that of the file.
    double &unknown = of.scale[t], &shares = of.scale[2 * count + t];
    double& squares = of.scale[3 * count + t];
    shares = MEMORY * shares + weight * share;
    const double limit =
        seen[t] > SETTLED ? 4.0 * (unknown * unknown) : std::numeric_limits<double>::infinity();
    squares = MEMORY * squares + weight * share * std::min(error * error, limit);
    unknown = std::sqrt((squares + loss[t] * loss[t]) / (shares + 1.0));
    of.scale[count + t] = spread[t];
}

/// Chooses the predictor of each target: the file where it has always been a whole number.
///
/// Of the file and the residuals, the simplest one that no other beats clearly: by 5 %, and features
/// by a hundredth of the change too. One that is in use is kept until it is beaten at all. Of squared
/// errors the least one is chosen once the file is beaten.
void RegressionSamples::choose() {
    Regression& of = *regression_;
    std::vector<std::int64_t> chosen(of.count, FILE_ALONE);
    for (int t = 0; t < of.count; ++t) {
        if (whole_[t] || !(seen[t] >= (squared_ ? ENOUGH : 2.0))) continue;
        double least = loss[t];
        for (std::int64_t kind = LINEAR; kind <= (of.features() > 0 ? FULL : LINEAR); ++kind) {
            const bool in_use = kind == of.predictors()[t];
            const double factor = in_use || (squared_ && chosen[t] != FILE_ALONE) ? 1.0 : BETTER;
            const double fine = squared_ || chosen[t] == FILE_ALONE ? 0.0 : 0.01 * spread[t];
            const double own = loss[kind * of.count + t];
            double doubted = 0.0;  // two standard errors of the difference to the file's mean error
            if (squared_ && chosen[t] == FILE_ALONE && !in_use) {
                const double steps = std::min(seen[t] / 3.0 + 1.0, 1.0 / (1.0 - MEMORY));
                doubted = 2.0 * std::sqrt(doubt[kind * of.count + t] / steps);
            }
            if (own + doubted < factor * least - fine) {
                chosen[t] = kind;
                least = own;
            }
        }
    }
    of.use_predictors(std::move(chosen));
}

// For Python ---------------------------------------------------------------------------------------

using Vector = In<double, nb::ndim<1>>;
using Truths = In<bool, nb::ndim<1>>;
using Columns = In<std::int64_t, nb::ndim<1>>;

void require_size(size_t size, int expected, const char* what) {
    if (size != static_cast<size_t>(expected)) {
        throw std::invalid_argument(std::string("the number of ") + what + " must be " +
                                    std::to_string(expected));
    }
}

int head_of(const Regression& of, std::int64_t head) {
    require(0 <= head && head < of.heads, "there is no such head");
    return static_cast<int>(head);
}

Array<double> design_matrix(const Regression& of, const In<double, nb::ndim<2>>& x,
                            const Columns& heads, const Vector& weight) {
    const size_t rows = x.shape(0), width = static_cast<size_t>(of.columns) + of.features();
    require_size(x.shape(1), of.depth, "inputs");
    require_size(heads.size(), static_cast<int>(rows), "heads");
    require_size(weight.size(), static_cast<int>(rows), "weights");
    for (size_t k = 0; k < rows; ++k) head_of(of, heads.data()[k]);
    std::vector<double> out(rows * width, 0.0), u(of.depth);
    for (size_t k = 0; k < rows; ++k) {
        of.normalise(x.data() + k * of.depth, u.data());
        of.fill_row(static_cast<int>(heads.data()[k]), u.data(), weight.data()[k],
                    out.data() + k * width);
    }
    return array_of(std::move(out), {rows, width});
}

void bind_regression(nb::module_& module) {
    nb::class_<Regression> bound(module, "Regression",
                                 "A regression of the one-step error of the file; see "
                                 "regression.hpp for its arrays.");
    bound.def(nb::new_([](int heads, int depth, int count) {
             return std::make_shared<Regression>(heads, depth, count);
         }), nb::arg("heads"), nb::arg("depth"), nb::arg("count"))
        .def_ro("heads", &Regression::heads)
        .def_ro("depth", &Regression::depth)
        .def_ro("count", &Regression::count)
        .def_ro("columns", &Regression::columns)
        .def_prop_rw("features", &Regression::features, &Regression::use_features,
                     "Number of random features in use: a multiple of SMOOTH, at most FEATURES.")
        .def_prop_rw("known", &Regression::known, &Regression::use_known,
                     "Rows of the inverse in use; 0 before the first solution.")
        .def_prop_rw(
            "kinds",
            [](const Regression& of) {
                return array_of(std::vector<std::int64_t>(of.predictors()),
                                {of.predictors().size()});
            },
            [](Regression& of, const In<std::int64_t, nb::ndim<1>>& kinds) {
                of.use_predictors(vector_of(kinds));
            },
            nb::for_getter(nb::rv_policy::move),
            "The predictor in use of each target `[T]`, a copy; set all at once.")
        .def("clear", &Regression::clear, "Set all weights to 0: the file predicts alone.")
        .def("design_matrix", &design_matrix, nb::arg("x"), nb::arg("heads"), nb::arg("weight"),
             "Return rows of the design matrix `[n, D + features]` of inputs `[n, d]` and their "
             "heads `[n]`, each times its weight `[n]`.");
    bound.attr("SMOOTH") = Regression::SMOOTH;
    bound.attr("FEATURES") = Regression::FEATURES;
    bound.attr("RANGE") = Regression::RANGE;
    bind_view(bound, "linear", &Regression::linear);
    bind_view(bound, "amplitude", &Regression::amplitude);
    bind_view(bound, "centre", &Regression::centre);
    bind_view(bound, "shrink", &Regression::shrink);
    bind_view(bound, "frequency", &Regression::frequency);
    bind_view(bound, "phase", &Regression::phase);
    bind_view(bound, "inverse", &Regression::inverse);
    bind_view(bound, "typical", &Regression::typical);
    bind_view(bound, "scale", &Regression::scale);
}

void require_columns(const Columns& columns, int size, size_t width, const char* what) {
    require_size(columns.size(), size, what);
    for (size_t k = 0; k < columns.size(); ++k) {
        require(0 <= columns.data()[k] && columns.data()[k] < static_cast<std::int64_t>(width),
                "there is no such fluent");
    }
}

int learn(RegressionSamples& samples, std::int64_t head, const ObservedStep& step,
          const Columns& inputs, const Columns& targets, const Truths& whole) {
    const Regression& of = samples.regression();
    const size_t width = step.state.size();
    require_columns(inputs, of.depth, width, "inputs");
    require_columns(targets, of.count, width, "targets");
    require_size(whole.size(), static_cast<int>(width), "fluents");
    return samples.learn(head_of(of, head), step, inputs.data(), targets.data(), whole.data());
}

int learn_worth(RegressionSamples& samples, std::int64_t head, const ObservedStep& step,
                bool rewarded) {
    const Regression& of = samples.regression();
    require_size(step.state.size() + 2, of.depth, "inputs");
    require_size(2, of.count, "targets");
    return samples.learn_worth(head_of(of, head), step, rewarded);
}

void bind_regression_samples(nb::module_& module) {
    using Of = RegressionSamples;
    nb::class_<Of> bound(module, "RegressionSamples",
                         "The newest samples of a regression, the ranges of their inputs, and the "
                         "errors of all predictors, each before the sample was learned from.");
    bound
        .def(nb::init<std::shared_ptr<Regression>, bool>(), nb::arg("regression"),
             nb::arg("squared") = false,
             "`squared`: errors of predictors are squared and none is an outlier, for what is rare.")
        .def("clear_errors", &Of::clear_errors, "Forget the errors of the predictors.")
        .def("learn", &learn, nb::arg("head"), nb::arg("step"), nb::arg("inputs"),
             nb::arg("targets"), nb::arg("whole"),
             "Learn from a step. Returns NOTHING, FORGET after a lasting change of the world, or else "
             "that sums or weights are due for an update. After an update, `choose` must be called.")
        .def("learn_worth", &learn_worth, nb::arg("head"), nb::arg("step"), nb::arg("rewarded"),
             "Learn reward, if `rewarded`, and end of a step by a head; returns what `learn` does.")
        .def("choose", &Of::choose, "Choose the predictor of each target, after `learn`.")
        .def("solution_due", &Of::solution_due, "Return whether weights are to be solved.")
        .def("normalise", &Of::normalise, "Normalise the inputs of the regression by their ranges.")
        .def_prop_rw("number", [](const Of& of) { return of.number; },
                     [](Of& of, std::int64_t number) {
                         require(number >= 0, "the number of samples is negative");
                         of.number = number;
                     }, "Number of samples ever kept.")
        .def_rw("start", &Of::start, "Number of samples before the present world.")
        .def_rw("pending", &Of::pending, "Number of the newest samples not in the sums.")
        .def_rw("since_solved", &Of::since_solved, "Samples since weights were solved.")
        .def_rw("outliers", &Of::outliers, "Successive outliers.")
        .def_rw("alarms", &Of::alarms, "Successive samples by which the world may have changed.")
        .def_rw("of_episode", &Of::of_episode, "Samples since the episode began.");
    bound.attr("NOTHING") = static_cast<int>(NOTHING);
    bound.attr("FORGET") = static_cast<int>(FORGET);
    bound.attr("KEPT") = Of::KEPT;
    bound.attr("PENDING") = Of::PENDING;
    bound.attr("REMEMBERED") = Of::REMEMBERED;
    bind_view(bound, "loss", &Of::loss);
    bind_view(bound, "doubt", &Of::doubt);
    bind_view(bound, "reliability", &Of::reliability);
    bind_view(bound, "seen", &Of::seen);
    bind_view(bound, "spread", &Of::spread);
    bind_view(bound, "samples", &Of::samples);
    bind_view(bound, "surprises", &Of::surprises);
    bind_view(bound, "low", &Of::low);
    bind_view(bound, "high", &Of::high);
    bind_view(bound, "block_of", &Of::block_of);
    bind_view(bound, "x", &Of::x);
    bind_view(bound, "y", &Of::y);
    bind_view(bound, "valid", &Of::valid);
    bind_view(bound, "head", &Of::head);
    bind_view(bound, "weight", &Of::weight);
}

}  // namespace

void bind_residual(nb::module_& module) {
    bind_regression(module);
    bind_regression_samples(module);
}

}  // namespace serp
