// Gradient updates of a Q-network. Compiled like network.cpp.
#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>

#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include "serp/_util/arrays.hpp"
#include "serp/_util/vector_code.hpp"
#include "serp/learning/network.hpp"
#include "serp/learning/samples.hpp"

namespace serp {

namespace {

constexpr double BETA1 = 0.9, BETA2 = 0.999, EPSILON = 1e-8;

SERP_VECTOR_PRODUCTS float square_of(const float* g, size_t count) {
    float square = 0.0f;
    for (size_t i = 0; i < count; ++i) square += g[i] * g[i];
    return square;
}

/// Returns 0 instead of a number below `least`. Moments whose gradient is 0 would otherwise become
/// subnormal numbers and stay there, and arithmetic with these is a hundred times slower.
SERP_INLINE float without_dust(float number, float least) {
    return std::fabs(number) < least ? 0.0f : number;
}

SERP_VECTOR_PRODUCTS void adam(float* __restrict p, const float* __restrict g, float* __restrict m,
                               float* __restrict v, size_t count, float factor, float rate,
                               float epsilon) {
    constexpr auto decay1 = static_cast<float>(BETA1), decay2 = static_cast<float>(BETA2);
    for (size_t i = 0; i < count; ++i) {
        const float slope = without_dust(g[i] * factor, 1e-18f);
        m[i] = without_dust(decay1 * m[i] + slope, 1e-18f);
        v[i] = without_dust(decay2 * v[i] + slope * slope, 1e-36f);
        p[i] -= rate * m[i] / (std::sqrt(v[i]) + epsilon);
    }
}

SERP_VECTOR_PRODUCTS void follow(float* __restrict slow, const float* __restrict p, size_t count,
                                 float share) {
    for (size_t i = 0; i < count; ++i) slow[i] += share * (p[i] - slow[i]);
}

SERP_VECTOR_PRODUCTS double deviation(const float* q, size_t count) {
    double mean = 0.0, squares = 0.0;
    for (size_t i = 0; i < count; ++i) mean += q[i];
    mean /= static_cast<double>(count);
    for (size_t i = 0; i < count; ++i) squares += (q[i] - mean) * (q[i] - mean);
    return std::sqrt(squares / static_cast<double>(count));
}

/// How samples are imitated: margin and weight of the loss.
struct Imitation {
    float margin, weight;
};

/// Writes the gradient of each member's mean loss; returns the mean loss over members and batch.
///
/// The target of a sample is reward + discount * next_q[best], with best the action of largest
/// choice_q among those not forbidden (the lowest index in a tie), and next_q[best] clipped to
/// lower and upper. With an action g to be imitated, weight * (max over a of
/// (q[a] + margin * [a != g]) - q[g]) is added to the loss of the sample. q and the like are
/// [E * B, A].
double td_gradient(const float* q, const float* next_q, const float* choice_q,
                   const ReplaySamples& samples, size_t batch, float lower, float upper,
                   Imitation imitation, float* q_gradient) {
    const size_t actions = samples.actions();
    const float share = 1.0f / static_cast<float>(batch);
    double loss = 0.0;
    for (size_t i = 0; i < samples.count(); ++i) {
        const size_t row = i * actions;
        const bool* forbidden = samples.forbidden.data() + row;
        const float *own = q + row, *choice = choice_q + row;
        float* gradient = q_gradient + row;
        size_t best = actions;
        for (size_t k = 0; k < actions; ++k)
            if (!forbidden[k] && (best == actions || choice[k] > choice[best])) best = k;
        const auto chosen = static_cast<size_t>(samples.action.data()[i]);
        if (best >= actions || chosen >= actions)
            throw std::invalid_argument("an action is out of range, or all are forbidden");
        float value = next_q[row + best];
        if (value < lower) value = lower;
        if (value > upper) value = upper;
        const float error =
            own[chosen] - (samples.reward.data()[i] + samples.discount.data()[i] * value);
        for (size_t k = 0; k < actions; ++k) gradient[k] = 0.0f;
        loss += error * error;
        gradient[chosen] = 2.0f * error * share;
        if (!samples.imitated.size() || imitation.weight <= 0.0f || samples.imitated.data()[i] < 0)
            continue;
        const auto wanted = static_cast<size_t>(samples.imitated.data()[i]);
        if (wanted >= actions) throw std::invalid_argument("an action is out of range");
        // In a tie that action is first: there the gradient of the loss is 0.
        size_t rival = wanted;
        float above = own[wanted];
        for (size_t k = 0; k < actions; ++k)
            if (k != wanted && own[k] + imitation.margin > above) {
                rival = k;
                above = own[k] + imitation.margin;
            }
        if (rival == wanted) continue;
        loss += imitation.weight * (above - own[wanted]);
        gradient[rival] += imitation.weight * share;
        gradient[wanted] -= imitation.weight * share;
    }
    return loss / static_cast<double>(samples.count());
}

/// A Q-network, its target network, and their gradient updates by Adam (arXiv 1412.6980).
///
/// Adam's moments are stored without their factors (1 - beta), which are part of the step size
/// instead: less arithmetic with the same result.
class QLearning {
public:
    QLearning(const std::vector<size_t>& sizes, bool layer_norm, size_t members, size_t batch,
              float learning_rate, float largest_norm, std::optional<float> polyak)
        : online(sizes, layer_norm, members),
          first(members * online.stride()),
          second(members * online.stride()),
          learning_rate_(learning_rate),
          largest_norm_(largest_norm),
          share_(polyak.value_or(0.0f)),
          passes_(members, Pass(online, batch)),
          next_pass_(online, batch),
          gradient_(online.stride()),
          q_(members * batch * online.actions()),
          next_q_(q_.size()),
          choice_q_(q_.size()),
          q_gradient_(q_.size()) {
        if (polyak) target.emplace(sizes, layer_norm, members);
    }

    /// Does one update on samples [E * B]; returns the loss. Without a finite loss nothing changes.
    double update(const ReplaySamples& samples, float lower, float upper, float imitation_weight) {
        const size_t batch = next_pass_.batch, members = online.members();
        const size_t outputs = batch * online.actions();
        if (samples.count() != members * batch || samples.inputs() != online.inputs() ||
            samples.actions() != online.actions())
            throw std::invalid_argument("the samples have other shapes than the network");
        const auto rows_of = [&](const ReplaySamples::Rows& inputs, size_t member) {
            return inputs.data() + member * batch * online.inputs();
        };
        for (size_t e = 0; e < members; ++e) {
            const auto value = [&](const QNetwork& network, const ReplaySamples::Rows& inputs,
                                   Pass& pass, std::vector<float>& q) {
                network.forward(e, rows_of(inputs, e), pass);
                std::copy_n(pass.q(), outputs, q.data() + e * outputs);
            };
            value(target ? *target : online, samples.next_observation, next_pass_, next_q_);
            if (target) value(online, samples.next_observation, next_pass_, choice_q_);
            value(online, samples.observation, passes_[e], q_);
        }
        Imitation imitation{0.0f, 0.0f};
        if (samples.imitated.size()) {
            const double unit = deviation(q_.data(), q_.size());
            imitation = {static_cast<float>(unit), static_cast<float>(imitation_weight * unit)};
        }
        const std::vector<float>& choice = target ? choice_q_ : next_q_;
        const double loss = td_gradient(q_.data(), next_q_.data(), choice.data(), samples, batch,
                                        lower, upper, imitation, q_gradient_.data());
        if (!std::isfinite(loss)) return loss;
        ++steps;
        for (size_t e = 0; e < members; ++e) {
            std::copy_n(q_gradient_.data() + e * outputs, outputs, passes_[e].q_gradient());
            online.backward(e, rows_of(samples.observation, e), passes_[e], gradient_.data());
            step(e, gradient_.data());
        }
        return loss;
    }

    /// Does one step along a gradient [E, P].
    void step_all(const In<float, nb::ndim<2>>& gradient) {
        if (gradient.shape(0) != online.members() || gradient.shape(1) != online.count())
            throw std::invalid_argument("the gradient has another shape");
        ++steps;
        for (size_t e = 0; e < online.members(); ++e) {
            std::copy_n(gradient.data() + e * online.count(), online.count(), gradient_.data());
            step(e, gradient_.data());
        }
    }

    QNetwork online;
    std::optional<QNetwork> target;
    Floats first, second;  ///< of the gradient's powers g, the sums of beta^(t - i) * g_i
    std::int64_t steps = 0;

private:
    /// Moves a member against its gradient, and the target network after it.
    void step(size_t member, const float* gradient) {
        const size_t at = member * online.stride(), count = online.count();
        const auto t = static_cast<double>(steps);
        const double spread = std::sqrt((1.0 - BETA2) / (1.0 - std::pow(BETA2, t)));
        const double rate = learning_rate_ * (1.0 - BETA1) / (1.0 - std::pow(BETA1, t)) / spread;
        const float norm = std::sqrt(square_of(gradient, count));
        adam(online.parameters(member), gradient, first.data() + at, second.data() + at, count,
             norm > largest_norm_ ? largest_norm_ / norm : 1.0f, static_cast<float>(rate),
             static_cast<float>(EPSILON / spread));
        if (target) follow(target->parameters(member), online.parameters(member), count, share_);
    }

    double learning_rate_;
    float largest_norm_, share_;
    std::vector<Pass> passes_;  // member -> its pass over the observations
    Pass next_pass_;
    Floats gradient_;                                       // [P]
    std::vector<float> q_, next_q_, choice_q_, q_gradient_;  // [E, B, A]
};

using Values = In<float, nb::ndim<3>>;

nb::tuple td_gradient_of(const Values& q, const Values& next_q, const Values& choice_q,
                         const ReplaySamples& samples, float lower, float upper, float margin,
                         float weight) {
    for (const Values* of : {&q, &next_q, &choice_q})
        if (of->shape(0) != q.shape(0) || of->shape(0) * of->shape(1) != samples.count() ||
            of->shape(2) != samples.actions())
            throw std::invalid_argument("other shapes");
    std::vector<float> gradient(q.size());
    const double loss = td_gradient(q.data(), next_q.data(), choice_q.data(), samples, q.shape(1),
                                    lower, upper, {margin, weight}, gradient.data());
    return nb::make_tuple(loss,
                          array_of(std::move(gradient), {q.shape(0), q.shape(1), q.shape(2)}));
}

template <Floats QLearning::*moment>
Array<float> view_of_moment(nb::handle self) {
    auto& learning = nb::cast<QLearning&>(self);
    return view_of((learning.*moment).data(), {learning.online.members(), learning.online.count()},
                   self, {static_cast<std::int64_t>(learning.online.stride()), 1});
}

}  // namespace

void bind_q_learning(nb::module_& module) {
    nb::class_<QLearning>(module, "QLearning",
                          "A Q-network, its target network, and their gradient updates.")
        .def(nb::init<const std::vector<size_t>&, bool, size_t, size_t, float, float,
                      std::optional<float>>(),
             nb::arg("sizes"), nb::arg("layer_norm"), nb::arg("members"), nb::arg("batch"),
             nb::arg("learning_rate"), nb::arg("largest_norm"), nb::arg("polyak").none())
        .def_ro("online", &QLearning::online, "The network that learns.")
        .def_prop_ro(
            "target",
            [](QLearning& self) { return self.target ? &*self.target : nullptr; },
            nb::rv_policy::reference_internal, nb::sig("def target(self) -> QNetwork | None"),
            "The target network, if there is one.")
        .def_prop_ro("first", &view_of_moment<&QLearning::first>,
                     nb::sig("def first(self) -> numpy.typing.NDArray[numpy.float32]"),
                     "Adam's first moment without its factor, a view [E, P].")
        .def_prop_ro("second", &view_of_moment<&QLearning::second>,
                     nb::sig("def second(self) -> numpy.typing.NDArray[numpy.float32]"),
                     "Likewise the second moment.")
        .def_rw("steps", &QLearning::steps, "Number of Adam's steps.")
        .def("update", &QLearning::update, nb::arg("samples"), nb::arg("lower"), nb::arg("upper"),
             nb::arg("imitation_weight"),
             "Do one gradient update on samples [E * B] and return the loss; if it is not finite, "
             "nothing changes. The value of a next state is clipped to lower and upper.")
        .def("step", &QLearning::step_all, nb::arg("gradient"),
             "Do Adam's step along a gradient [E, P].");
    module.def("td_gradient", &td_gradient_of, nb::arg("q"), nb::arg("next_q"), nb::arg("choice_q"),
               nb::arg("samples"), nb::arg("lower"), nb::arg("upper"), nb::arg("margin"),
               nb::arg("weight"),
               nb::sig("def td_gradient(q: numpy.typing.NDArray[numpy.float32], next_q: "
                       "numpy.typing.NDArray[numpy.float32], choice_q: "
                       "numpy.typing.NDArray[numpy.float32], samples: ReplaySamples, lower: float, "
                       "upper: float, margin: float, weight: float) -> tuple[float, "
                       "numpy.typing.NDArray[numpy.float32]]"),
               "Return the mean loss of a batch, and the gradient of each member's mean loss. The "
               "target of a sample is reward + discount * next_q[best], with best the action of "
               "largest choice_q among those not forbidden, and next_q[best] clipped to lower and "
               "upper. An action to be imitated adds weight * (max over a of (q[a] + margin * "
               "[a != g]) - q[g]). q and the like are [E, B, A].");
}

}  // namespace serp
