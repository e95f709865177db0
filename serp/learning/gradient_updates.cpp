// Gradient updates of a Q-network. Compiled like network.cpp.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include "serp/_util/arrays.hpp"
#include "serp/_util/checks.hpp"
#include "serp/_util/vector_code.hpp"
#include "serp/learning/network.hpp"

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

/// N samples of the replay memory, in the arrays given; `serp.learning.replay` describes the fields.
struct ReplaySamples {
    using Rows = Out<float, nb::ndim<2>>;
    using Numbers = Out<float, nb::ndim<1>>;
    using Actions = Out<std::int64_t, nb::ndim<1>>;
    using Bits = Out<std::uint8_t, nb::ndim<2>>;

    ReplaySamples(Rows observation, Actions action, Numbers reward, Rows next_observation,
                  Numbers discount, Actions imitated, Bits allowed)
        : observation(std::move(observation)),
          action(std::move(action)),
          reward(std::move(reward)),
          next_observation(std::move(next_observation)),
          discount(std::move(discount)),
          imitated(std::move(imitated)),
          allowed(std::move(allowed)) {
        require(this->observation.shape(0) == count() &&
                    this->next_observation.shape(0) == count() &&
                    this->next_observation.shape(1) == inputs() && this->reward.size() == count() &&
                    this->discount.size() == count() && this->imitated.size() == count() &&
                    this->allowed.shape(0) == count(),
                "the fields of samples have other shapes");
    }

    size_t count() const { return action.size(); }
    size_t inputs() const { return observation.shape(1); }

    Rows observation;
    Actions action;
    Numbers reward;
    Rows next_observation;
    Numbers discount;
    Actions imitated;
    Bits allowed;
};

/// Positions of samples [E * B].
using Drawn = In<std::int64_t, nb::ndim<1>>;

/// Writes the gradient of each member's mean loss; returns the mean loss over members and batch.
///
/// The target of a sample is reward + discount * next_q[best], with best the action of largest
/// choice_q among the allowed ones, or all where none is (the lowest index in a tie). With an action g
/// to be imitated, weight * (max over a of (q[a] + margin * [a != g]) - q[g]) is added to the loss of
/// the sample. q and the like are [E * B, A].
double td_gradient(const float* q, const float* next_q, const float* choice_q, size_t actions,
                   const ReplaySamples& samples, const Drawn& drawn, size_t batch, float margin,
                   float weight, float* q_gradient) {
    const float share = 1.0f / static_cast<float>(batch);
    double loss = 0.0;
    for (size_t i = 0; i < drawn.size(); ++i) {
        const size_t row = i * actions, sample = drawn.data()[i];
        const float *own = q + row, *choice = choice_q + row;
        float* gradient = q_gradient + row;
        const auto chosen = static_cast<size_t>(samples.action.data()[sample]);
        require(chosen < actions, "an action is out of range");
        const std::uint8_t* allowed = samples.allowed.data() + sample * samples.allowed.shape(1);
        size_t best = actions;
        for (size_t k = 0; k < actions; ++k)
            if (allowed[k / 8] >> (k % 8) & 1 && (best == actions || choice[k] > choice[best]))
                best = k;
        if (best == actions) best = std::max_element(choice, choice + actions) - choice;
        const float error = own[chosen] - (samples.reward.data()[sample] +
                                           samples.discount.data()[sample] * next_q[row + best]);
        std::fill_n(gradient, actions, 0.0f);
        loss += error * error;
        gradient[chosen] = 2.0f * error * share;
        if (weight <= 0.0f || samples.imitated.data()[sample] < 0) continue;
        const auto wanted = static_cast<size_t>(samples.imitated.data()[sample]);
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
    return loss / static_cast<double>(drawn.size());
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
          inputs_(members * batch * online.inputs()),
          next_inputs_(batch * online.inputs()),
          q_(members * batch * online.actions()),
          next_q_(q_.size()),
          choice_q_(q_.size()),
          q_gradient_(q_.size()) {
        if (polyak) target.emplace(sizes, layer_norm, members);
    }

    /// Does one update on the samples that were drawn; returns the loss. Without a finite loss nothing
    /// changes.
    double update(const ReplaySamples& samples, const Drawn& drawn, float imitation_weight) {
        const size_t batch = next_pass_.batch, members = online.members();
        const size_t outputs = batch * online.actions();
        require(drawn.size() == members * batch && samples.inputs() == online.inputs() &&
                    samples.allowed.shape(1) == (online.actions() + 7) / 8,
                "the shapes of the samples do not fit the network");
        for (size_t i = 0; i < drawn.size(); ++i)
            require(drawn.data()[i] >= 0 &&
                        static_cast<size_t>(drawn.data()[i]) < samples.count(),
                    "there is no such sample");
        const auto value = [&](const QNetwork& network, size_t member, const float* inputs,
                               Pass& pass, std::vector<float>& q) {
            network.forward(member, inputs, pass);
            std::copy_n(pass.q(), outputs, q.data() + member * outputs);
        };
        for (size_t e = 0; e < members; ++e) {
            gather(samples.next_observation, drawn, e, next_inputs_.data());
            value(target ? *target : online, e, next_inputs_.data(), next_pass_, next_q_);
            if (target) value(online, e, next_inputs_.data(), next_pass_, choice_q_);
            gather(samples.observation, drawn, e, inputs_of(e));
            value(online, e, inputs_of(e), passes_[e], q_);
        }
        const double unit = imitation_weight > 0.0f ? deviation(q_.data(), q_.size()) : 0.0;
        const std::vector<float>& choice = target ? choice_q_ : next_q_;
        const double loss = td_gradient(
            q_.data(), next_q_.data(), choice.data(), online.actions(), samples, drawn, batch,
            static_cast<float>(unit), static_cast<float>(imitation_weight * unit),
            q_gradient_.data());
        if (!std::isfinite(loss)) return loss;
        ++steps;
        for (size_t e = 0; e < members; ++e) {
            std::copy_n(q_gradient_.data() + e * outputs, outputs, passes_[e].q_gradient());
            online.backward(e, inputs_of(e), passes_[e], gradient_.data());
            step(e, gradient_.data());
        }
        return loss;
    }

    QNetwork online;
    std::optional<QNetwork> target;
    Floats first, second;  ///< of the gradient's powers g, the sums of beta^(t - i) * g_i
    std::int64_t steps = 0;

private:
    float* inputs_of(size_t member) {
        return inputs_.data() + member * next_pass_.batch * online.inputs();
    }

    /// Copies the rows of a member's samples to [B, F].
    void gather(const ReplaySamples::Rows& rows, const Drawn& drawn, size_t member,
                float* to) const {
        const size_t batch = next_pass_.batch, width = online.inputs();
        for (size_t i = 0; i < batch; ++i)
            std::copy_n(rows.data() + drawn.data()[member * batch + i] * width, width,
                        to + i * width);
    }

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
    std::vector<float> inputs_, next_inputs_;                // [E, B, F] and [B, F]
    std::vector<float> q_, next_q_, choice_q_, q_gradient_;  // [E, B, A]
};

template <Floats QLearning::*moment>
Array<float> view_of_moment(nb::handle self) {
    auto& learning = nb::cast<QLearning&>(self);
    return view_of((learning.*moment).data(), {learning.online.members(), learning.online.count()},
                   self, {static_cast<std::int64_t>(learning.online.stride()), 1});
}

}  // namespace

void bind_gradient_updates(nb::module_& module) {
    nb::class_<ReplaySamples>(module, "ReplaySamples",
                              "N samples in arrays, which are those given; see "
                              "`serp.learning.replay`.")
        .def(nb::init<ReplaySamples::Rows, ReplaySamples::Actions, ReplaySamples::Numbers,
                      ReplaySamples::Rows, ReplaySamples::Numbers, ReplaySamples::Actions,
                      ReplaySamples::Bits>(),
             nb::arg("observation").noconvert(), nb::arg("action").noconvert(),
             nb::arg("reward").noconvert(), nb::arg("next_observation").noconvert(),
             nb::arg("discount").noconvert(), nb::arg("imitated").noconvert(),
             nb::arg("allowed").noconvert());
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
        .def("update", &QLearning::update, nb::arg("samples"), nb::arg("drawn"),
             nb::arg("imitation_weight"),
             "Do one gradient update on the samples at positions [E * B] and return the loss; if it "
             "is not finite, nothing changes.");
}

}  // namespace serp
