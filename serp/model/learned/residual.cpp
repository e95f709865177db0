// Which predictor of a residual has been best; the regression as Python sees it.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>

#include <nanobind/stl/pair.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/vector.h>

#include "serp/_util/arrays.hpp"
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

/// Errors of all predictors of a regression, each before the sample was learned from.
class PredictionErrors {
public:
    explicit PredictionErrors(std::shared_ptr<Regression> regression)
        : regression_(std::move(regression)) {
        clear();
    }

    void clear() {
        const auto count = static_cast<std::size_t>(regression_->count);
        loss.assign(PREDICTORS * count, 0.0);
        seen.assign(count, 0.0);
        spread.assign(count, 0.0);
        samples.assign(static_cast<std::size_t>(regression_->heads) * count, 0.0);
        surprises.assign(1, 0.0);
    }

    std::pair<double, bool> account(int head, const double* x, const double* y, const bool* valid,
                                    const double* change);
    bool choose(const bool* enabled);

    Regression& regression() { return *regression_; }

    std::vector<double> loss;       ///< [4, T] moving averages of errors by predictor
    std::vector<double> seen;       ///< [T] samples in them
    std::vector<double> spread;     ///< [T] mean change
    std::vector<double> samples;    ///< [H, T] samples of each head
    std::vector<double> surprises;  ///< [1] fraction of surprises

private:
    double predict(int head, const double* x, const double* y);
    void update(int head, int t, double weight, double share, double change);

    std::shared_ptr<Regression> regression_;
    std::vector<double> errors_, u_, z_, room_;
};

/// Writes the errors [4, T] of all predictors; returns the leverage.
double PredictionErrors::predict(int head, const double* x, const double* y) {
    const Regression& of = *regression_;
    const int count = of.count;
    errors_.resize(PREDICTORS * static_cast<std::size_t>(count));
    u_.resize(of.depth);
    z_.resize(Regression::SMOOTH);
    of.normalise(x, u_.data());
    for (int t = 0; t < count; ++t) {
        errors_[t] = y[t];
        for (int kind = LINEAR; kind <= FULL; ++kind) {
            errors_[kind * count + t] = y[t] - of.linear_of(head, kind, t, u_.data());
        }
    }
    if (of.features() == 0) return of.leverage(head, u_.data(), z_.data(), room_);
    double share = 1.0;
    for (int chunk = 0; chunk < Regression::CHUNKS; ++chunk) {
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

/// Adds a sample to the losses: inputs [d], observed next values less those of effects and processes
/// [T], whether that is observed [T], and the change [T].
///
/// Returns the weight of the sample in the regression, and whether the world may have changed.
std::pair<double, bool> PredictionErrors::account(int head, const double* x, const double* y,
                                                  const bool* valid, const double* change) {
    const Regression& of = *regression_;
    const int count = of.count;
    const double share = predict(head, x, y);
    double worst = 0.0;
    bool surprise = false;
    for (int t = 0; t < count; ++t) {
        const double seen_of_head = samples[head * count + t];
        if (!valid[t] || !(seen_of_head >= FEW)) continue;
        const double error = errors_[of.predictors()[t] * count + t];
        const double least = 1e-9 * (1.0 + std::abs(y[t] - error));
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
        if (valid[t]) update(head, t, weight, share, change[t]);
    }
    return {weight, surprise && surprises[0] > LASTING};
}

void PredictionErrors::update(int head, int t, double weight, double share, double change) {
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
    for (int kind = FILE_ALONE; kind <= FULL; ++kind) {
        double off = std::abs(errors_[kind * count + t]);
        double& average = loss[kind * count + t];
        if (kind != FILE_ALONE && seen[t] <= FEW) {
            off = std::min(off, std::abs(errors_[t]));
            if (seen[t] == 2.0) {
                average = off;
                continue;
            }
        }
        average += rate * (off - average);
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

/// Chooses the predictor of each target where `enabled` [T]; returns whether any is a residual.
///
/// Of the file and the residuals, the simplest one that no other beats clearly: by 5 %, and features
/// by a hundredth of the change too. One that is in use is kept until it is beaten at all.
bool PredictionErrors::choose(const bool* enabled) {
    Regression& of = *regression_;
    std::vector<std::int64_t> chosen(of.count, FILE_ALONE);
    for (int t = 0; t < of.count; ++t) {
        if (!enabled[t] || !(seen[t] >= 2.0)) continue;
        double least = loss[t];
        for (std::int64_t kind = LINEAR; kind <= (of.features() > 0 ? FULL : LINEAR); ++kind) {
            const double factor = kind == of.predictors()[t] ? 1.0 : BETTER;
            const double fine = chosen[t] == FILE_ALONE ? 0.0 : 0.01 * spread[t];
            const double own = loss[kind * of.count + t];
            if (own < factor * least - fine) {
                chosen[t] = kind;
                least = own;
            }
        }
    }
    of.use_predictors(std::move(chosen));
    return of.most() != FILE_ALONE;
}

// For Python ---------------------------------------------------------------------------------------

using Vector = In<double, nb::ndim<1>>;
using Truths = In<bool, nb::ndim<1>>;

void require_size(size_t size, int expected, const char* what) {
    if (size != static_cast<size_t>(expected)) {
        throw std::invalid_argument(std::string("the number of ") + what + " must be " +
                                    std::to_string(expected));
    }
}

int head_of(const Regression& of, std::int64_t head) {
    if (head < 0 || head >= of.heads) throw std::invalid_argument("there is no such head");
    return static_cast<int>(head);
}

/// Binds a writable view of numbers. `shape(owner)` is its shape.
template <class Class, class Shape>
void bind_view(nb::class_<Class>& bound, const char* name, std::vector<double> Class::*numbers,
               Shape shape, const char* doc) {
    bound.def_prop_ro(
        name,
        [numbers, shape](nb::pointer_and_handle<Class> self) {
            const std::vector<size_t> sizes = shape(*self.p);
            return Array<double>((self.p->*numbers).data(), sizes.size(), sizes.data(), self.h);
        },
        nb::rv_policy::reference, doc);
}

Array<double> design_matrix(const Regression& of, const In<double, nb::ndim<2>>& x,
                            const In<std::int64_t, nb::ndim<1>>& heads, const Vector& weight) {
    const size_t rows = x.shape(0), width = static_cast<size_t>(of.columns) + of.features();
    require_size(x.shape(1), of.depth, "inputs");
    require_size(heads.size(), static_cast<int>(rows), "heads");
    require_size(weight.size(), static_cast<int>(rows), "weights");
    for (size_t k = 0; k < rows; ++k) head_of(of, heads.data()[k]);
    std::vector<double> out(rows * width, 0.0), u(of.depth);
    {
        nb::gil_scoped_release released;
        for (size_t k = 0; k < rows; ++k) {
            of.normalise(x.data() + k * of.depth, u.data());
            of.fill_row(static_cast<int>(heads.data()[k]), u.data(), weight.data()[k],
                        out.data() + k * width);
        }
    }
    return array_of(std::move(out), {rows, width});
}

void bind_regression(nb::module_& module) {
    nb::class_<Regression> bound(module, "Regression",
                                 "A regression of the one-step error of the file: H heads (action "
                                 "schemas), d inputs, T targets, D columns of the linear part.");
    bound.def(nb::new_([](int heads, int depth, int count) {
             return std::make_shared<Regression>(heads, depth, count);
         }), nb::arg("heads"), nb::arg("depth"), nb::arg("count"))
        .def_ro("heads", &Regression::heads)
        .def_ro("depth", &Regression::depth)
        .def_ro("count", &Regression::count)
        .def_ro("columns", &Regression::columns)
        .def_prop_rw("features", &Regression::features, &Regression::use_features,
                     "Number of random features in use: 0 or FEATURES.")
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
    using Of = Regression;
    const auto sizes = [](auto... numbers) {
        return std::vector<size_t>{static_cast<size_t>(numbers)...};
    };
    bind_view(bound, "linear", &Of::linear,
              [=](const Of& of) { return sizes(of.heads, 3, of.count, 1 + of.depth); },
              "`[H, 3, T, 1 + d]` weights of a constant and the normalised inputs, by predictor.");
    bind_view(bound, "amplitude", &Of::amplitude,
              [=](const Of& of) { return sizes(2, of.count, Of::FEATURES); },
              "`[2, T, FEATURES]` weights of the random features, by predictor.");
    bind_view(bound, "centre", &Of::centre, [=](const Of& of) { return sizes(of.depth); },
              "`[d]`; normalised inputs are (x - centre) * shrink.");
    bind_view(bound, "shrink", &Of::shrink, [=](const Of& of) { return sizes(of.depth); }, "`[d]`.");
    bind_view(bound, "frequency", &Of::frequency,
              [=](const Of& of) { return sizes(of.depth, Of::FEATURES); }, "`[d, FEATURES]`.");
    bind_view(bound, "phase", &Of::phase, [=](const Of&) { return sizes(Of::FEATURES); },
              "`[FEATURES]`.");
    bind_view(bound, "inverse", &Of::inverse,
              [=](const Of& of) { return sizes(of.columns + Of::SMOOTH, of.columns + Of::SMOOTH); },
              "`[D + SMOOTH, same]` transposed inverse of the Cholesky factor of the smooth model.");
    bind_view(bound, "typical", &Of::typical,
              [=](const Of& of) { return sizes(of.heads, of.count); },
              "`[H, T]` typical error of the predictor in use.");
    bind_view(bound, "scale", &Of::scale, [=](const Of& of) { return sizes(4, of.count); },
              "`[4, T]` typical error where nothing is known, typical change, and two sums that the "
              "first is computed from.");
}

std::pair<double, bool> account(PredictionErrors& errors, std::int64_t head, const Vector& x,
                                const Vector& y, const Truths& valid, const Vector& change) {
    const Regression& of = errors.regression();
    require_size(x.size(), of.depth, "inputs");
    for (const size_t size : {y.size(), valid.size(), change.size()}) {
        require_size(size, of.count, "targets");
    }
    return errors.account(head_of(of, head), x.data(), y.data(), valid.data(), change.data());
}

bool choose(PredictionErrors& errors, const Truths& enabled) {
    require_size(enabled.size(), errors.regression().count, "targets");
    return errors.choose(enabled.data());
}

void bind_prediction_errors(nb::module_& module) {
    nb::class_<PredictionErrors> bound(module, "PredictionErrors",
                                       "Errors of all predictors of a regression, each before the "
                                       "sample was learned from.");
    bound.def(nb::init<std::shared_ptr<Regression>>(), nb::arg("regression"))
        .def("clear", &PredictionErrors::clear, "Forget all samples.")
        .def("account", &account, nb::arg("head"), nb::arg("x"), nb::arg("y"), nb::arg("valid"),
             nb::arg("change"),
             "Add a sample: inputs `[d]`, observed next values less those of effects and processes "
             "`[T]`, whether that is observed `[T]`, and the change `[T]`.\n\n"
             "Returns its weight in the regression, and whether the world may have changed.")
        .def("choose", &choose, nb::arg("enabled"),
             "Choose the predictor of each target; `enabled` `[T]` says whether it may be a "
             "residual.\n\nReturns whether any is. Of the file and the residuals, it is the simplest "
             "one that no other beats clearly: by 5 %, and features by a hundredth of the change "
             "too. One that is in use is kept until it is beaten at all.");
    using Of = PredictionErrors;
    const auto targets = [](const Of& of) { return std::vector<size_t>{of.seen.size()}; };
    bind_view(bound, "loss", &Of::loss,
              [](const Of& of) { return std::vector<size_t>{PREDICTORS, of.seen.size()}; },
              "`[4, T]` moving averages of errors by predictor.");
    bind_view(bound, "seen", &Of::seen, targets, "`[T]` samples in them.");
    bind_view(bound, "spread", &Of::spread, targets, "`[T]` mean change.");
    bind_view(bound, "samples", &Of::samples,
              [](const Of& of) {
                  return std::vector<size_t>{of.samples.size() / of.seen.size(), of.seen.size()};
              },
              "`[H, T]` samples of each head.");
    bind_view(bound, "surprises", &Of::surprises, [](const Of&) { return std::vector<size_t>{1}; },
              "`[1]` fraction of surprises.");
}

}  // namespace

void bind_residual(nb::module_& module) {
    bind_regression(module);
    bind_prediction_errors(module);
}

}  // namespace serp
