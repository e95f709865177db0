// This file is compiled with sums that may be reordered and contracted for vector instructions, the
// same way in every run on one kind of machine; NaN and infinities keep their meaning.
#include "serp/learning/network.hpp"

#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <new>
#include <stdexcept>
#include <string>

#include "serp/_util/arrays.hpp"
#include "serp/_util/vector_code.hpp"

namespace serp {

namespace {

constexpr float NORM_EPSILON = 1e-5f;  // torch.nn.LayerNorm's
constexpr size_t WIDE = 32, NARROW = 16;  // columns of a block of a product

/// A matrix in memory: entry (i, k) is numbers[i * row + k * column].
struct Matrix {
    const float* numbers;
    size_t row, column;
};

/// Writes ROWS x COLUMNS entries of a product, of which `width` columns exist in c. The loops over
/// columns become vectors of sums in registers.
template <int ROWS, size_t COLUMNS>
SERP_INLINE void multiply_block(Matrix a, size_t inner, const float* __restrict b, size_t b_row,
                                const float* bias, float* c, size_t c_row, size_t width) {
    float sum[ROWS][COLUMNS];
    for (int i = 0; i < ROWS; ++i)
        for (size_t j = 0; j < COLUMNS; ++j) sum[i][j] = 0.0f;
    for (size_t k = 0; k < inner; ++k, b += b_row, a.numbers += a.column)
        for (int i = 0; i < ROWS; ++i) {
            const float factor = a.numbers[i * a.row];
            if constexpr (COLUMNS > NARROW) {
                for (size_t j = 0; j < COLUMNS; ++j) sum[i][j] += factor * b[j];
            } else {  // GCC would unroll so short a loop before it looks for vectors
#pragma GCC unroll 1
                for (size_t j = 0; j < COLUMNS; ++j) sum[i][j] += factor * b[j];
            }
        }
    for (int i = 0; i < ROWS; ++i)
        for (size_t j = 0; j < width; ++j)
            c[i * c_row + j] = bias ? sum[i][j] + bias[j] : sum[i][j];
}

/// Writes `width` columns of a product.
template <size_t COLUMNS>
SERP_INLINE void multiply_columns(Matrix a, size_t rows, size_t inner, const float* b, size_t b_row,
                                  const float* bias, float* c, size_t c_row, size_t width) {
    size_t i = 0;
    for (; i + 4 <= rows; i += 4, c += 4 * c_row, a.numbers += 4 * a.row)
        multiply_block<4, COLUMNS>(a, inner, b, b_row, bias, c, c_row, width);
    for (; i < rows; ++i, c += c_row, a.numbers += a.row)
        multiply_block<1, COLUMNS>(a, inner, b, b_row, bias, c, c_row, width);
}

/// Sets c [rows, columns] to a [rows, inner] * b [inner, columns] + bias [columns].
SERP_VECTOR_PRODUCTS void multiply(Matrix a, size_t rows, size_t inner, const float* b,
                                   size_t columns, const float* bias, float* c, float* scratch) {
    size_t j = 0;
    for (; j + WIDE <= columns; j += WIDE)
        multiply_columns<WIDE>(a, rows, inner, b + j, columns, bias ? bias + j : nullptr, c + j,
                               columns, WIDE);
    for (; j < columns; j += NARROW) {  // a block needs all its columns
        const size_t width = std::min(NARROW, columns - j);
        for (size_t k = 0; k < inner; ++k)
            for (size_t n = 0; n < NARROW; ++n)
                scratch[k * NARROW + n] = n < width ? b[k * columns + j + n] : 0.0f;
        multiply_columns<NARROW>(a, rows, inner, scratch, NARROW, bias ? bias + j : nullptr, c + j,
                                 columns, width);
    }
}

/// Writes the transpose [columns, rows] of a matrix [rows, columns].
SERP_VECTOR_PRODUCTS void transpose(const float* a, size_t rows, size_t columns, float* out) {
    for (size_t j = 0; j < columns; ++j)
        for (size_t i = 0; i < rows; ++i) out[j * rows + i] = a[i * columns + j];
}

SERP_VECTOR_PRODUCTS void cut_rows(float* z, size_t count) {
    for (size_t j = 0; j < count; ++j) z[j] = z[j] <= 0.0f ? 0.0f : z[j];  // NaN stays NaN
}

/// Parameters of a layer's vectors, [outputs] each, or their gradients.
template <class Number>
struct Vectors {
    Number *__restrict bias, *__restrict gain, *__restrict shift;
};

template <class Number>
Vectors<Number> vectors_of(Number* parameters, const Layer& layer) {
    Number* bias = parameters + layer.bias;
    return {bias, bias + layer.outputs, bias + 2 * layer.outputs};
}

/// Sets out to ReLU(LayerNorm(z)) and z to the normalised value before gain and shift.
SERP_VECTOR_PRODUCTS void normalize_rows(float* __restrict z, float* __restrict out,
                                         float* __restrict inverse, size_t rows, size_t outputs,
                                         Vectors<const float> of) {
    const float share = 1.0f / static_cast<float>(outputs);
    for (size_t i = 0; i < rows; ++i, z += outputs, out += outputs) {
        float mean = 0.0f, variance = 0.0f;
        for (size_t j = 0; j < outputs; ++j) mean += z[j];
        mean *= share;
        for (size_t j = 0; j < outputs; ++j) variance += (z[j] - mean) * (z[j] - mean);
        const float factor = 1.0f / std::sqrt(variance * share + NORM_EPSILON);
        inverse[i] = factor;
        for (size_t j = 0; j < outputs; ++j) {
            const float normal = (z[j] - mean) * factor;
            z[j] = normal;
            const float value = normal * of.gain[j] + of.shift[j];
            out[j] = value <= 0.0f ? 0.0f : value;
        }
    }
}

/// Turns the gradient in the outputs of a layer into that before its LayerNorm; writes the
/// gradients of its vectors. With x the normalised row and g = slope * gain, it is
/// (g - mean(g) - x * mean(g * x)) / standard deviation (arXiv 1607.06450).
SERP_VECTOR_PRODUCTS void normalize_rows_backward(float* __restrict slope,
                                                  const float* __restrict out,
                                                  const float* __restrict normal,
                                                  const float* __restrict inverse, size_t rows,
                                                  size_t outputs, Vectors<const float> of,
                                                  Vectors<float> gradient) {
    const float share = 1.0f / static_cast<float>(outputs);
    for (size_t j = 0; j < outputs; ++j)
        gradient.bias[j] = gradient.gain[j] = gradient.shift[j] = 0.0f;
    for (size_t i = 0; i < rows; ++i, slope += outputs, out += outputs, normal += outputs) {
        float mean = 0.0f, along = 0.0f;
        for (size_t j = 0; j < outputs; ++j) {
            const float value = out[j] > 0.0f ? slope[j] : 0.0f;
            gradient.shift[j] += value;
            gradient.gain[j] += value * normal[j];
            slope[j] = value * of.gain[j];
            mean += slope[j];
            along += slope[j] * normal[j];
        }
        mean *= share;
        along *= share;
        for (size_t j = 0; j < outputs; ++j) {
            const float value = inverse[i] * (slope[j] - mean - normal[j] * along);
            slope[j] = value;
            gradient.bias[j] += value;
        }
    }
}

SERP_VECTOR_PRODUCTS void cut_rows_backward(float* __restrict slope, const float* __restrict out,
                                            size_t count) {
    for (size_t j = 0; j < count; ++j) slope[j] = out[j] > 0.0f ? slope[j] : 0.0f;
}

SERP_VECTOR_PRODUCTS void sum_rows(const float* row, size_t rows, size_t outputs,
                                   float* __restrict sum) {
    for (size_t j = 0; j < outputs; ++j) sum[j] = 0.0f;
    for (size_t i = 0; i < rows; ++i, row += outputs)
        for (size_t j = 0; j < outputs; ++j) sum[j] += row[j];
}

SERP_VECTOR_PRODUCTS void add(float* __restrict sum, const float* __restrict q, size_t count) {
    for (size_t j = 0; j < count; ++j) sum[j] += q[j];
}

}  // namespace

Pass::Pass(const QNetwork& network, size_t batch) : batch(batch) {
    if (batch > 1'000'000'000) throw std::invalid_argument("a batch may have at most 10^9 rows");
    size_t largest = 0;
    for (const Layer& layer : network.layers()) {
        const size_t size = batch * layer.outputs;
        layers.push_back({Floats(size), Floats(layer.normalized ? size : 0),
                          Floats(layer.normalized ? batch : 0), Floats(size)});
        // For a transpose of the weights and for the columns that a block of a product fills up.
        largest = std::max(largest, layer.inputs * layer.outputs);
        largest = std::max(largest, NARROW * std::max({layer.inputs, layer.outputs, batch}));
    }
    scratch = Floats(2 * largest);
}

QNetwork::QNetwork(std::vector<size_t> sizes, bool layer_norm, size_t members)
    : sizes_(std::move(sizes)), members_(members) {
    const auto possible = [](size_t count) { return count && count <= 1'000'000'000; };
    if (sizes_.size() < 2 || !possible(members) ||
        !std::all_of(sizes_.begin(), sizes_.end(), possible))
        throw std::invalid_argument("a network needs members, inputs and outputs, 1 to 10^9 each");
    size_t start = 0;
    for (size_t i = 1; i < sizes_.size(); ++i) {
        const bool normalized = layer_norm && i + 1 < sizes_.size();
        const size_t bias = start + sizes_[i - 1] * sizes_[i];
        const size_t end = bias + (normalized ? 3 : 1) * sizes_[i];
        layers_.push_back({start, bias, end, sizes_[i - 1], sizes_[i], normalized});
        start = end;
        if (end > (size_t{1} << 40) / members) throw std::bad_alloc();
    }
    parameters_ = Floats(members_ * stride());
}

void QNetwork::forward(size_t member, const float* inputs, Pass& pass) const {
    const float *below = inputs, *own = parameters(member);
    for (size_t k = 0; k < layers_.size(); ++k) {
        const Layer& layer = layers_[k];
        Activations& here = pass.layers[k];
        float* z = here.z.data();
        multiply({below, layer.inputs, 1}, pass.batch, layer.inputs, own + layer.start,
                 layer.outputs, own + layer.bias, z, pass.scratch.data());
        if (layer.normalized)
            normalize_rows(z, here.h.data(), here.inverse.data(), pass.batch, layer.outputs,
                           vectors_of(own, layer));
        else if (k + 1 < layers_.size())
            cut_rows(z, pass.batch * layer.outputs);
        below = layer.normalized ? here.h.data() : z;
    }
}

void QNetwork::backward(size_t member, const float* inputs, Pass& pass, float* gradient) const {
    const float* own = parameters(member);
    const size_t batch = pass.batch;
    float* scratch = pass.scratch.data();
    for (size_t k = layers_.size(); k-- > 0;) {
        const Layer& layer = layers_[k];
        float* slope = pass.layers[k].slope.data();
        if (!layer.normalized)
            sum_rows(slope, batch, layer.outputs, vectors_of(gradient, layer).bias);
        const float* below = inputs;
        if (k) {
            const Activations& of = pass.layers[k - 1];
            below = (layers_[k - 1].normalized ? of.h : of.z).data();
        }
        multiply({below, 1, layer.inputs}, layer.inputs, batch, slope, layer.outputs, nullptr,
                 gradient + layer.start, scratch);
        if (!k) return;
        const Layer& lower = layers_[k - 1];
        Activations& there = pass.layers[k - 1];
        float* transposed = scratch + NARROW * std::max(layer.inputs, layer.outputs);
        transpose(own + layer.start, layer.inputs, layer.outputs, transposed);
        multiply({slope, layer.outputs, 1}, batch, layer.outputs, transposed, layer.inputs, nullptr,
                 there.slope.data(), scratch);
        if (lower.normalized)
            normalize_rows_backward(there.slope.data(), there.h.data(), there.z.data(),
                                    there.inverse.data(), batch, lower.outputs,
                                    vectors_of(own, lower), vectors_of(gradient, lower));
        else
            cut_rows_backward(there.slope.data(), there.z.data(), batch * lower.outputs);
    }
}

void QNetwork::mean(const float* inputs, size_t batch, float* q) {
    if (kept_.empty() || kept_[0].batch != batch) kept_.assign(1, Pass(*this, batch));
    const size_t size = batch * actions();
    std::fill_n(q, size, 0.0f);
    for (size_t e = 0; e < members_; ++e) {
        forward(e, inputs, kept_[0]);
        add(q, kept_[0].q(), size);
    }
    for (size_t i = 0; i < size; ++i) q[i] /= static_cast<float>(members_);
}

void QNetwork::each(const float* inputs, float* q) {
    if (kept_.empty() || kept_[0].batch != 1) kept_.assign(1, Pass(*this, 1));
    for (size_t e = 0; e < members_; ++e) {
        forward(e, inputs, kept_[0]);
        std::copy_n(kept_[0].q(), actions(), q + e * actions());
    }
}

namespace {

Array<float> q_of(QNetwork& network, const In<float>& inputs) {
    const size_t axes = inputs.ndim();
    if ((axes != 1 && axes != 2) || inputs.shape(axes - 1) != network.inputs())
        throw std::invalid_argument("an input must have shape (" +
                                    std::to_string(network.inputs()) + ",), or (batch, " +
                                    std::to_string(network.inputs()) + ")");
    const size_t batch = axes == 1 ? 1 : inputs.shape(0);
    std::vector<float> q(batch * network.actions());
    network.mean(inputs.data(), batch, q.data());
    if (axes == 1) return array_of(std::move(q), {network.actions()});
    return array_of(std::move(q), {batch, network.actions()});
}

Array<float> values_of(QNetwork& network, const In<float>& input) {
    if (input.ndim() != 1 || input.shape(0) != network.inputs())
        throw std::invalid_argument("an input must have shape (" +
                                    std::to_string(network.inputs()) + ",)");
    std::vector<float> q(network.members() * network.actions());
    network.each(input.data(), q.data());
    return array_of(std::move(q), {network.members(), network.actions()});
}

}  // namespace

void bind_network(nb::module_& module) {
    module.attr("NORM_EPSILON") = NORM_EPSILON;
    nb::class_<Layer>(module, "Layer", "Where a layer lies in the parameters of each member.")
        .def_ro("start", &Layer::start, "Column of the first weight.")
        .def_ro("bias", &Layer::bias, "Column of the first bias.")
        .def_ro("end", &Layer::end, "The first column after the layer.")
        .def_ro("inputs", &Layer::inputs)
        .def_ro("outputs", &Layer::outputs)
        .def_ro("normalized", &Layer::normalized, "Whether gain and shift follow the bias.");
    nb::class_<QNetwork>(module, "QNetwork",
                         "One Q-network, or several of one shape side by side (\"members\").")
        .def(nb::init<std::vector<size_t>, bool, size_t>(), nb::arg("sizes"),
             nb::arg("layer_norm") = false, nb::arg("members") = 1)
        .def_prop_ro("sizes", &QNetwork::sizes)
        .def_prop_ro("members", &QNetwork::members)
        .def_prop_ro("layers", &QNetwork::layers)
        .def_prop_ro(
            "parameters",
            [](nb::handle self) {
                auto& network = nb::cast<QNetwork&>(self);
                return view_of(network.parameters(), {network.members(), network.count()}, self,
                               {static_cast<std::int64_t>(network.stride()), 1});
            },
            nb::sig("def parameters(self) -> numpy.typing.NDArray[numpy.float32]"),
            "A view [E, P]: member by member, layer by layer the weights [inputs, outputs], the "
            "bias and, under LayerNorm, gain and shift.")
        .def("q", &q_of, nb::arg("inputs"),
             "Return the mean of the members' Q-values: [A] of an input [F], [B, A] of [B, F].")
        .def("values", &values_of, nb::arg("input"),
             "Return the Q-values of each member [E, A] for an input [F].");
}

}  // namespace serp
