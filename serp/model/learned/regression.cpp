#include "serp/model/learned/regression.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <utility>

#include "serp/_util/checks.hpp"
#include "serp/_util/vector_code.hpp"

namespace serp {

namespace {

constexpr int SMOOTH = Regression::SMOOTH, FEATURES = Regression::FEATURES;

/// std::floor, in arithmetic that compilers turn into vector code.
inline double floor_of(double x) {
    constexpr double large = 4503599627370496.0;  // 2^52: from it on every number is whole
    const double shift = std::copysign(large, x);
    const double nearest = (x + shift) - shift;
    const double floor = nearest - (nearest > x ? 1.0 : 0.0);
    return std::abs(x) < large ? floor : x;
}

/// Writes approximate cosines of phase + frequency * u. Rows of `frequency` are FEATURES long.
SERP_VECTOR_CODE
void waves(const double* frequency, const double* phase, const double* u, int depth,
           double* __restrict z) {
    double sums[SMOOTH];
    for (int k = 0; k < SMOOTH; ++k) sums[k] = phase[k];
    for (int i = 0; i < depth; ++i) {
        const double x = u[i];
        const double* row = frequency + static_cast<std::size_t>(i) * FEATURES;
        for (int k = 0; k < SMOOTH; ++k) sums[k] += row[k] * x;
    }
    for (int k = 0; k < SMOOTH; ++k) {
        double turns = sums[k] * 0.15915494309189535 + 0.25;
        turns -= floor_of(turns + 0.5);
        const double y = 8.0 * turns - 16.0 * turns * std::abs(turns);
        z[k] = 0.225 * (y * std::abs(y) - y) + y;
    }
}

/// Adds the second half of the numbers to the first one, until one is left.
template <int width>
inline double pairwise_sum(double* numbers) {
    if constexpr (width == 1) {
        return numbers[0];
    } else {
        for (int k = 0; k < width / 2; ++k) numbers[k] += numbers[k + width / 2];
        return pairwise_sum<width / 2>(numbers);
    }
}

/// Returns the product of two chunks, summed pairwise: in vector code, the same bits always.
SERP_VECTOR_CODE
double dot_chunk(const double* weights, const double* z) {
    double products[SMOOTH];
    for (int k = 0; k < SMOOTH; ++k) products[k] = weights[k] * z[k];
    return pairwise_sum<SMOOTH>(products);
}

/// Adds columns of a lower triangular matrix, each times a number, to `sums` [rows].
///
/// `columns` are rows of its transpose; the diagonal of the first one is at `first`, and before it
/// there is 0. Each sum adds them in order.
SERP_VECTOR_CODE
void add_columns(const double* columns, std::size_t stride, int first, int rows, const double* numbers,
                 int count, double* __restrict sums) {
    int k = 0;
    for (; k + 4 <= count; k += 4) {  // four at once, which saves reading and writing the sums
        const double *a = columns + k * stride, *b = a + stride, *c = b + stride, *d = c + stride;
        const double x = numbers[k], y = numbers[k + 1], z = numbers[k + 2], w = numbers[k + 3];
        for (int i = first + k; i < rows; ++i) {
            sums[i] = (((sums[i] + a[i] * x) + b[i] * y) + c[i] * z) + d[i] * w;
        }
    }
    for (; k < count; ++k) {
        const double* column = columns + k * stride;
        for (int i = first + k; i < rows; ++i) sums[i] += column[i] * numbers[k];
    }
}

int sized(bool fits, int number) {
    require(fits, "a regression needs heads, inputs and targets, and not too many");
    return number;
}

}  // namespace

Regression::Regression(int heads_, int depth_, int count_)
    : heads(sized(1 <= heads_ && heads_ <= 4096, heads_)),
      depth(sized(0 <= depth_ && depth_ <= 4096, depth_)),
      count(sized(1 <= count_ && count_ <= 4096, count_)), columns((1 + heads) * (1 + depth)),
      linear(heads, 3, count, 1 + depth), amplitude(2, count, FEATURES), centre(depth),
      shrink(depth), frequency(depth, FEATURES), phase(FEATURES),
      inverse(columns + SMOOTH, columns + SMOOTH), typical(heads, count), scale(4, count),
      predictors_(count, FILE_ALONE) {}

void Regression::clear() {
    for (Block<double>* block : {&linear, &amplitude, &centre, &shrink, &frequency, &phase,
                                 &inverse, &typical, &scale}) {
        block->fill(0.0);
    }
    std::fill(predictors_.begin(), predictors_.end(), FILE_ALONE);
    most_ = FILE_ALONE;
    features_ = known_ = 0;
}

void Regression::use_predictors(std::vector<std::int64_t> predictors) {
    require(predictors.size() == predictors_.size(), "there must be one predictor for each target");
    for (const std::int64_t each : predictors) {
        require(FILE_ALONE <= each && each <= FULL, "there is no such predictor");
    }
    std::copy(predictors.begin(), predictors.end(), predictors_.begin());
    most_ = *std::max_element(predictors_.begin(), predictors_.end());
}

void Regression::use_features(int features) {
    require(0 <= features && features <= FEATURES && features % SMOOTH == 0,
            "the number of random features is out of range");
    features_ = features;
}

void Regression::use_known(int known) {
    require(known == 0 || known == columns || (known == columns + SMOOTH && features_ > 0),
            "the number of known columns is out of range");
    known_ = known;
}

int Regression::rows_in_use() const { return most_ <= LINEAR ? std::min(known_, columns) : known_; }

void Regression::normalise(const double* x, double* u) const {
    for (int i = 0; i < depth; ++i) u[i] = (x[i] - centre[i]) * shrink[i];
}

void Regression::features_of(const double* u, int chunk, double* z) const {
    waves(frequency.data() + chunk * SMOOTH, phase.data() + chunk * SMOOTH, u, depth, z);
}

double Regression::linear_of(int head, std::int64_t predictor, int target, const double* u) const {
    const std::size_t row = (static_cast<std::size_t>(head) * 3 + (predictor - LINEAR)) * count;
    const double* weights = linear.data() + (row + target) * (1 + depth);
    double total = weights[0];
    for (int i = 0; i < depth; ++i) total += weights[1 + i] * u[i];
    return total;
}

double Regression::wave_of(std::int64_t predictor, int target, int chunk, const double* z) const {
    const std::size_t row = static_cast<std::size_t>(predictor - CURVED) * count + target;
    return dot_chunk(amplitude.data() + row * FEATURES + chunk * SMOOTH, z);
}

double Regression::leverage(int head, const double* u, const double* z,
                            std::vector<double>& room) const {
    const int rows = rows_in_use();
    if (rows == 0) return 1.0;
    const std::size_t stride = static_cast<std::size_t>(columns) + SMOOTH;
    const int size = 1 + depth;
    room.assign(static_cast<std::size_t>(rows) + size, 0.0);
    double *sums = room.data(), *inputs = sums + rows;
    inputs[0] = 1.0;
    std::copy(u, u + depth, inputs + 1);
    for (const int first : {0, (1 + head) * size}) {
        add_columns(inverse.data() + first * stride, stride, first, rows, inputs, size, sums);
    }
    if (rows > columns) {
        add_columns(inverse.data() + columns * stride, stride, columns, rows, z, SMOOTH, sums);
    }
    double q = 0.0;
    for (int i = 0; i < rows; ++i) q += sums[i] * sums[i];
    return q / (1.0 + q);
}

void Regression::fill_row(int head, const double* u, double weight, double* row) const {
    for (const int start : {0, (1 + head) * (1 + depth)}) {
        row[start] = weight;
        for (int i = 0; i < depth; ++i) row[start + 1 + i] = weight * u[i];
    }
    for (int first = 0; first < features_; first += SMOOTH) {
        double* z = row + columns + first;
        features_of(u, first / SMOOTH, z);
        for (int k = 0; k < SMOOTH; ++k) z[k] *= weight;
    }
}

bool Regression::file_suffices() const {
    if (known_ == 0 || most_ != FILE_ALONE) return false;
    for (int head = 0; head < heads; ++head) {
        for (int t = 0; t < count; ++t) {
            // A head without samples says nothing of the file.
            if (typical[head * count + t] > 0.5 * scale[count + t]) return false;
        }
    }
    return true;
}

}  // namespace serp
