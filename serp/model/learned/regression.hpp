// A regression of the one-step error of the file, and what its weights predict.
#pragma once

#include <cstdint>
#include <vector>

#include "serp/_util/arrays.hpp"

namespace serp {

/// The predictor of a fluent: the file alone, or the file with a linear model, one with the
/// smoothest random features, or one with all of them.
enum Predictor : std::int64_t { FILE_ALONE, LINEAR, CURVED, FULL };

/// One Bayesian linear regression of H heads (action schemas), d inputs and T targets.
///
/// The linear part of its design matrix has a constant and the normalised inputs, the same for every
/// head and again for each head; D columns. Random Fourier features follow.
class Regression {
public:
    /// Numbers of random Fourier features: of a smooth model, and of a full one.
    static constexpr int SMOOTH = 64, FEATURES = 256, CHUNKS = FEATURES / SMOOTH;
    /// Larger normalised inputs are outside of the range of the data.
    static constexpr double RANGE = 1.3;

    /// All weights are 0: the file predicts alone. Throws std::invalid_argument for no heads.
    Regression(int heads, int depth, int count);

    const int heads, depth, count, columns;  ///< H, d, T, D
    Block<double> linear;     ///< [H, 3, T, 1 + d] weights of constant and inputs, by predictor
    Block<double> amplitude;  ///< [2, T, FEATURES] weights of random features, by predictor
    Block<double> centre;     ///< [d] normalised inputs are (x - centre) * shrink
    Block<double> shrink;     ///< [d]
    Block<double> frequency;  ///< [d, FEATURES]
    Block<double> phase;      ///< [FEATURES]
    /// [D + SMOOTH, same] transposed inverse of the Cholesky factor of the smooth model: an upper
    /// triangular matrix.
    Block<double> inverse;
    Block<double> typical;    ///< [H, T] typical error of the predictor in use
    /// [4, T] typical error where nothing is known, typical change, and two sums that the first is
    /// computed from.
    Block<double> scale;

    /// The predictor in use of each target [T].
    const std::vector<std::int64_t>& predictors() const { return predictors_; }
    /// The largest predictor in use.
    std::int64_t most() const { return most_; }
    /// Number of random features in use: a multiple of SMOOTH, at most FEATURES.
    int features() const { return features_; }
    /// Rows of the inverse in use: 0 before the first solution, D, or D + SMOOTH.
    int known() const { return known_; }
    /// These throw std::invalid_argument where a number is out of range.
    void use_predictors(std::vector<std::int64_t> predictors);
    void use_features(int features);
    void use_known(int known);

    /// Sets all weights to 0, so that the file predicts alone.
    void clear();

    /// Writes normalised inputs `u` [d] of inputs `x` [d].
    void normalise(const double* x, double* u) const;

    /// Writes a chunk of random features [SMOOTH] of normalised inputs.
    ///
    /// They are a fast approximation of the cosine, accurate to 0.001.
    void features_of(const double* u, int chunk, double* z) const;

    /// Returns what the linear model of a predictor adds to a target.
    double linear_of(int head, std::int64_t predictor, int target, const double* u) const;

    /// Returns what a chunk of random features [SMOOTH] adds to a target, by CURVED or FULL.
    double wave_of(std::int64_t predictor, int target, int chunk, const double* z) const;

    /// Whether the leverage depends on random features.
    bool leverage_needs_features() const { return rows_in_use() > columns; }

    /// Returns the leverage of normalised inputs: 0 where much is known, 1 where nothing is.
    ///
    /// It is q / (1 + q), where q is the posterior variance of the smooth model in units of that of
    /// an observation. `z` [SMOOTH] is the first chunk of features. Where no target is predicted
    /// from features, what the linear model knows is known. `room` is scratch memory.
    double leverage(int head, const double* u, const double* z, std::vector<double>& room) const;

    /// Fills a row [D + features] of the design matrix, times its weight. It begins with zeros.
    void fill_row(int head, const double* u, double weight, double* row) const;

    /// Whether errors after all actions were typically at most half of the change.
    bool file_suffices() const;

private:
    int rows_in_use() const;

    std::vector<std::int64_t> predictors_;
    std::int64_t most_ = FILE_ALONE;
    int features_ = 0, known_ = 0;
};

}  // namespace serp
