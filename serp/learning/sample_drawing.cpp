#include "serp/learning/samples.hpp"

#include <algorithm>
#include <utility>

#include "serp/_util/checks.hpp"

namespace serp {

ReplaySamples::ReplaySamples(Rows observation, Actions action, Numbers reward,
                             Rows next_observation, Numbers discount,
                             Out<bool, nb::ndim<2>> forbidden, Actions imitated)
    : observation(std::move(observation)),
      action(std::move(action)),
      reward(std::move(reward)),
      next_observation(std::move(next_observation)),
      discount(std::move(discount)),
      forbidden(std::move(forbidden)),
      imitated(std::move(imitated)) {
    require(this->observation.shape(0) == count() && this->next_observation.shape(0) == count() &&
                this->next_observation.shape(1) == inputs() && this->reward.size() == count() &&
                this->discount.size() == count() && this->forbidden.shape(0) == count() &&
                (!this->imitated.size() || this->imitated.size() == count()),
            "the fields of samples have other shapes");
}

void ReplaySamples::draw(const ReplaySamples& store, size_t size,
                         const In<double, nb::ndim<1>>& uniform) {
    const size_t drawn = count(), width = inputs(), choices = actions();
    require(size && size <= store.count() && store.inputs() == width &&
                store.actions() == choices && !store.imitated.size() == !imitated.size() &&
                uniform.size() == drawn,
            "samples and numbers to draw them have other shapes");
    for (size_t i = 0; i < drawn; ++i) {
        const double number = uniform.data()[i];
        require(number >= 0.0 && number < 1.0, "a number lies outside of [0, 1)");
        const auto place = static_cast<size_t>(number * static_cast<double>(size));
        const size_t row = std::min(place, size - 1);
        std::copy_n(store.observation.data() + row * width, width,
                    observation.data() + i * width);
        std::copy_n(store.next_observation.data() + row * width, width,
                    next_observation.data() + i * width);
        std::copy_n(store.forbidden.data() + row * choices, choices,
                    forbidden.data() + i * choices);
        action.data()[i] = store.action.data()[row];
        reward.data()[i] = store.reward.data()[row];
        discount.data()[i] = store.discount.data()[row];
        if (imitated.size()) imitated.data()[i] = store.imitated.data()[row];
    }
}

void bind_replay(nb::module_& module) {
    nb::class_<ReplaySamples>(module, "ReplaySamples",
                        "N samples in arrays, which are those given; see `serp.learning.replay`.")
        .def(nb::init<ReplaySamples::Rows, ReplaySamples::Actions, ReplaySamples::Numbers,
                      ReplaySamples::Rows, ReplaySamples::Numbers, Out<bool, nb::ndim<2>>,
                      ReplaySamples::Actions>(),
             nb::arg("observation").noconvert(), nb::arg("action").noconvert(),
             nb::arg("reward").noconvert(), nb::arg("next_observation").noconvert(),
             nb::arg("discount").noconvert(), nb::arg("forbidden").noconvert(),
             nb::arg("imitated").noconvert())
        .def("draw", &ReplaySamples::draw, nb::arg("store"), nb::arg("size"), nb::arg("uniform"),
             "Replace all samples by samples of `store`, one of its first `size` for each number "
             "in [0, 1).");
}

}  // namespace serp
