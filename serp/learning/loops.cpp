// The loops of the Q-networks other than matrix products; network.py and q_learning.py call them.
//
// E is members, B batch, H a layer's outputs, P parameters of a member. This file is compiled with
// sums that may be reordered for vector instructions, the same way in every run on one kind of
// machine; NaN and infinities keep their meaning.
#include <cmath>
#include <cstdint>
#include <optional>
#include <stdexcept>

#include <nanobind/stl/optional.h>

#include "serp/_util/arrays.hpp"
#include "serp/_util/vector_code.hpp"

namespace serp {

namespace {

using Batch = Out<float, nb::ndim<3>>;
using Rows = Out<float, nb::ndim<2>>;

constexpr float NORM_EPSILON = 1e-5f;  // torch.nn.LayerNorm's
constexpr double BETA1 = 0.9, BETA2 = 0.999;

/// Parameters of one layer's vectors: bias [H] and, with LayerNorm, gain [H] and shift [H].
struct Vectors {
    float *bias, *gain, *shift;
};

void require(bool holds, const char* what) {
    if (!holds) throw std::invalid_argument(what);
}

Vectors vectors_of(const Rows& flat, size_t member, size_t at, size_t outputs, size_t parts) {
    require(at + parts * outputs <= flat.shape(1), "a layer lies outside of the parameters");
    float* bias = flat.data() + member * flat.shape(1) + at;
    return {bias, bias + outputs, bias + 2 * outputs};
}

void require_members(const Batch& z, const Rows& flat) {
    require(z.shape(0) == flat.shape(0), "other numbers of members");
}

void require_equal(const Batch& one, const Batch& other) {
    for (size_t k = 0; k < 3; ++k) require(one.shape(k) == other.shape(k), "other shapes");
}

SERP_VECTOR_CODE void bias_rows(float* row, size_t rows, size_t outputs, const float* bias,
                                float floor) {
    for (size_t i = 0; i < rows; ++i, row += outputs)
        for (size_t j = 0; j < outputs; ++j) {
            const float value = row[j] + bias[j];
            row[j] = value <= floor ? floor : value;  // NaN stays NaN
        }
}

void add_bias(const Batch& z, const Rows& parameters, size_t at, float floor) {
    require_members(z, parameters);
    const size_t rows = z.shape(1), outputs = z.shape(2);
    for (size_t e = 0; e < z.shape(0); ++e)
        bias_rows(z.data() + e * rows * outputs, rows, outputs,
                  vectors_of(parameters, e, at, outputs, 1).bias, floor);
}

SERP_VECTOR_CODE void normalize_rows(float* __restrict row, float* __restrict out,
                                     float* __restrict inverse, size_t rows, size_t outputs,
                                     Vectors of) {
    const float share = 1.0f / static_cast<float>(outputs);
    for (size_t i = 0; i < rows; ++i, row += outputs, out += outputs) {
        float mean = 0.0f, variance = 0.0f;
        for (size_t j = 0; j < outputs; ++j) {
            row[j] += of.bias[j];
            mean += row[j];
        }
        mean *= share;
        for (size_t j = 0; j < outputs; ++j) {
            const float centred = row[j] - mean;
            row[j] = centred;
            variance += centred * centred;
        }
        const float factor = 1.0f / std::sqrt(variance * share + NORM_EPSILON);
        inverse[i] = factor;
        for (size_t j = 0; j < outputs; ++j) {
            const float normal = row[j] * factor;
            row[j] = normal;
            const float value = normal * of.gain[j] + of.shift[j];
            out[j] = value <= 0.0f ? 0.0f : value;
        }
    }
}

void normalize(const Batch& z, const Batch& h, const Rows& inverse, const Rows& parameters,
               size_t at) {
    require_members(z, parameters);
    require_equal(z, h);
    const size_t rows = z.shape(1), outputs = z.shape(2);
    require(inverse.shape(0) == z.shape(0) && inverse.shape(1) == rows, "other shapes");
    for (size_t e = 0; e < z.shape(0); ++e)
        normalize_rows(z.data() + e * rows * outputs, h.data() + e * rows * outputs,
                       inverse.data() + e * rows, rows, outputs,
                       vectors_of(parameters, e, at, outputs, 3));
}

SERP_VECTOR_CODE void sum_rows(const float* row, size_t rows, size_t outputs,
                               float* __restrict sum) {
    for (size_t j = 0; j < outputs; ++j) sum[j] = 0.0f;
    for (size_t i = 0; i < rows; ++i, row += outputs)
        for (size_t j = 0; j < outputs; ++j) sum[j] += row[j];
}

void add_bias_backward(const Batch& d, const Rows& gradient, size_t at) {
    require_members(d, gradient);
    const size_t rows = d.shape(1), outputs = d.shape(2);
    for (size_t e = 0; e < d.shape(0); ++e)
        sum_rows(d.data() + e * rows * outputs, rows, outputs,
                 vectors_of(gradient, e, at, outputs, 1).bias);
}

SERP_VECTOR_CODE void mask_rows(float* __restrict row, const float* __restrict out, size_t count) {
    for (size_t j = 0; j < count; ++j) row[j] = out[j] > 0.0f ? row[j] : 0.0f;
}

void relu_backward(const Batch& d, const Batch& h, const Rows& gradient, size_t at) {
    require_equal(d, h);
    mask_rows(d.data(), h.data(), d.size());
    add_bias_backward(d, gradient, at);
}

SERP_VECTOR_CODE void normalize_rows_backward(float* __restrict row, const float* __restrict out,
                                              const float* __restrict normal,
                                              const float* __restrict inverse, size_t rows,
                                              size_t outputs, Vectors of, Vectors gradient) {
    const float share = 1.0f / static_cast<float>(outputs);
    float *__restrict bias = gradient.bias, *__restrict gain = gradient.gain,
          *__restrict shift = gradient.shift;
    for (size_t j = 0; j < outputs; ++j) bias[j] = gain[j] = shift[j] = 0.0f;
    for (size_t i = 0; i < rows; ++i, row += outputs, out += outputs, normal += outputs) {
        float mean = 0.0f, along = 0.0f;
        for (size_t j = 0; j < outputs; ++j) {
            const float value = out[j] > 0.0f ? row[j] : 0.0f;
            shift[j] += value;
            gain[j] += value * normal[j];
            row[j] = value * of.gain[j];
            mean += row[j];
            along += row[j] * normal[j];
        }
        mean *= share;
        along *= share;
        for (size_t j = 0; j < outputs; ++j) {
            const float value = inverse[i] * (row[j] - mean - normal[j] * along);
            row[j] = value;
            bias[j] += value;
        }
    }
}

void normalize_backward(const Batch& d, const Batch& h, const Batch& z, const Rows& inverse,
                        const Rows& parameters, const Rows& gradient, size_t at) {
    require_members(d, parameters);
    require_members(d, gradient);
    require_equal(d, h);
    require_equal(d, z);
    const size_t rows = d.shape(1), outputs = d.shape(2), size = rows * outputs;
    require(inverse.shape(0) == d.shape(0) && inverse.shape(1) == rows, "other shapes");
    for (size_t e = 0; e < d.shape(0); ++e)
        normalize_rows_backward(d.data() + e * size, h.data() + e * size, z.data() + e * size,
                                inverse.data() + e * rows, rows, outputs,
                                vectors_of(parameters, e, at, outputs, 3),
                                vectors_of(gradient, e, at, outputs, 3));
}

SERP_VECTOR_CODE float square_of(const float* g, size_t count) {
    float square = 0.0f;
    for (size_t i = 0; i < count; ++i) square += g[i] * g[i];
    return square;
}

SERP_VECTOR_CODE void adam_member(float* __restrict p, const float* __restrict g,
                                  float* __restrict m, float* __restrict v, size_t count,
                                  float factor, float rate, float epsilon) {
    constexpr auto decay1 = static_cast<float>(BETA1), decay2 = static_cast<float>(BETA2);
    for (size_t i = 0; i < count; ++i) {
        const float slope = g[i] * factor;
        m[i] = decay1 * m[i] + slope;
        v[i] = decay2 * v[i] + slope * slope;
        p[i] -= rate * m[i] / (std::sqrt(v[i]) + epsilon);
    }
}

SERP_VECTOR_CODE void follow(float* __restrict slow, const float* __restrict p, size_t count,
                             float share) {
    for (size_t i = 0; i < count; ++i) slow[i] += share * (p[i] - slow[i]);
}

void adam(const Rows& parameters, const Rows& gradient, const Rows& first, const Rows& second,
          float rate, float epsilon, float largest_norm, const Rows& average, float share) {
    const size_t members = parameters.shape(0), count = parameters.shape(1);
    for (const Rows* of : {&gradient, &first, &second})
        require(of->shape(0) == members && of->shape(1) == count, "other shapes");
    require(average.shape(0) == members && (average.shape(1) == 0 || average.shape(1) == count),
            "other shapes");
    for (size_t e = 0; e < members; ++e) {
        const size_t at = e * count;
        const float norm = std::sqrt(square_of(gradient.data() + at, count));
        adam_member(parameters.data() + at, gradient.data() + at, first.data() + at,
                    second.data() + at, count, norm > largest_norm ? largest_norm / norm : 1.0f,
                    rate, epsilon);
        if (average.shape(1)) follow(average.data() + at, parameters.data() + at, count, share);
    }
}

SERP_VECTOR_CODE double deviation(const float* q, size_t count) {
    double mean = 0.0, squares = 0.0;
    for (size_t i = 0; i < count; ++i) mean += q[i];
    mean /= static_cast<double>(count);
    for (size_t i = 0; i < count; ++i) squares += (q[i] - mean) * (q[i] - mean);
    return std::sqrt(squares / static_cast<double>(count));
}

double td_gradient(const Batch& q, const Batch& next_q, const Batch& choice_q,
                   const In<std::int64_t, nb::ndim<2>>& action, const In<float, nb::ndim<2>>& reward,
                   const In<float, nb::ndim<2>>& discount, const In<bool, nb::ndim<3>>& forbidden,
                   float lower, float upper,
                   const std::optional<In<std::int64_t, nb::ndim<2>>>& imitated, float margin,
                   float weight, const Batch& q_gradient) {
    require_equal(q, next_q);
    require_equal(q, choice_q);
    require_equal(q, q_gradient);
    const size_t samples = q.shape(0) * q.shape(1), actions = q.shape(2);
    require(action.size() == samples && reward.size() == samples && discount.size() == samples &&
                forbidden.size() == samples * actions && (!imitated || imitated->size() == samples),
            "other shapes");
    const float share = 1.0f / static_cast<float>(q.shape(1));
    double loss = 0.0;
    for (size_t i = 0; i < samples; ++i) {
        const size_t row = i * actions;
        const float* own = q.data() + row;
        float* gradient = q_gradient.data() + row;
        size_t best = actions;
        for (size_t k = 0; k < actions; ++k)
            if (!forbidden.data()[row + k] &&
                (best == actions || choice_q.data()[row + k] > choice_q.data()[row + best]))
                best = k;
        const auto chosen = static_cast<size_t>(action.data()[i]);
        require(best < actions && chosen < actions, "an action is out of range, or all are forbidden");
        float value = next_q.data()[row + best];
        if (value < lower) value = lower;
        if (value > upper) value = upper;
        const float error = own[chosen] - (reward.data()[i] + discount.data()[i] * value);
        for (size_t k = 0; k < actions; ++k) gradient[k] = 0.0f;
        loss += error * error;
        gradient[chosen] = 2.0f * error * share;
        if (!imitated || weight <= 0.0f || imitated->data()[i] < 0) continue;
        const auto wanted = static_cast<size_t>(imitated->data()[i]);
        require(wanted < actions, "an action is out of range");
        // In a tie that action is first: there the gradient of the loss is 0.
        size_t rival = wanted;
        float above = own[wanted];
        for (size_t k = 0; k < actions; ++k)
            if (k != wanted && own[k] + margin > above) {
                rival = k;
                above = own[k] + margin;
            }
        if (rival == wanted) continue;
        loss += weight * (above - own[wanted]);
        gradient[rival] += weight * share;
        gradient[wanted] -= weight * share;
    }
    return loss / static_cast<double>(samples);
}

}  // namespace

void bind_learning(nb::module_& module) {
    module.attr("NORM_EPSILON") = NORM_EPSILON;
    const auto free = nb::call_guard<nb::gil_scoped_release>();
    module.def("add_bias", &add_bias, nb::arg("z"), nb::arg("parameters"), nb::arg("at"),
               nb::arg("floor"), free, "Set z [E, B, H] to max(z + bias, floor).");
    module.def("normalize", &normalize, nb::arg("z"), nb::arg("h"), nb::arg("inverse"),
               nb::arg("parameters"), nb::arg("at"), free,
               "Set h [E, B, H] to ReLU(LayerNorm(z + bias)). z becomes the normalised value before "
               "gain and shift, inverse [E, B] the reciprocal of each row's standard deviation.");
    module.def("add_bias_backward", &add_bias_backward, nb::arg("d"), nb::arg("gradient"),
               nb::arg("at"), free,
               "Write the gradient of a bias: the sum of d [E, B, H] over the batch.");
    module.def("relu_backward", &relu_backward, nb::arg("d"), nb::arg("h"), nb::arg("gradient"),
               nb::arg("at"), free,
               "Turn dloss/dh in d [E, B, H] into dloss/dz; write the gradient of the bias.");
    module.def("normalize_backward", &normalize_backward, nb::arg("d"), nb::arg("h"), nb::arg("z"),
               nb::arg("inverse"), nb::arg("parameters"), nb::arg("gradient"), nb::arg("at"), free,
               "Turn dloss/dh in d into dloss/dz; the other arrays are as `normalize` left them. "
               "Write the gradients of bias, gain and shift. With x the normalised row and g = d * "
               "gain, dz = (g - mean(g) - x * mean(g * x)) / standard deviation (arXiv 1607.06450).");
    module.def("adam", &adam, nb::arg("parameters"), nb::arg("gradient"), nb::arg("first"),
               nb::arg("second"), nb::arg("rate"), nb::arg("epsilon"), nb::arg("largest_norm"),
               nb::arg("average"), nb::arg("share"), free,
               "Do one step of Adam in place; all arrays are [E, P], average may be [E, 0].");
    module.def("deviation", [](const Batch& q) { return deviation(q.data(), q.size()); },
               nb::arg("q"), free, "Return the standard deviation of q [E, B, A].");
    module.def("td_gradient", &td_gradient, nb::arg("q"), nb::arg("next_q"), nb::arg("choice_q"),
               nb::arg("action"), nb::arg("reward"), nb::arg("discount"), nb::arg("forbidden"),
               nb::arg("lower"), nb::arg("upper"), nb::arg("imitated").none(), nb::arg("margin"),
               nb::arg("weight"), nb::arg("q_gradient"), free,
               "Write the gradient of each member's mean loss; return the mean loss over members "
               "and batch. The target of a sample is reward + discount * next_q[best], with best the "
               "action of largest choice_q among those not forbidden (the lowest index in a tie), "
               "and next_q[best] clipped to lower and upper. With an action g to be imitated, "
               "weight * (max over a of (q[a] + margin * [a != g]) - q[g]) is added to the loss of "
               "the sample. q and the like are [E, B, A].");
}

}  // namespace serp
