#include "serp/learning/replay.hpp"

#include <algorithm>
#include <utility>

#include "serp/_util/checks.hpp"

namespace serp {

namespace {

/// Returns the mirror image of an action; that of -1, no action, is -1.
std::int64_t image_of(std::int64_t action, const Mirror& mirror) {
    if (action == -1) return -1;
    require(action >= 0 && static_cast<size_t>(action) < mirror.actions.size(),
            "an action is out of range");
    return mirror.actions.data()[action];
}

/// Copies a row of inputs, or its mirror image.
void copy_inputs(const float* from, float* to, size_t count, const Mirror* mirror) {
    if (!mirror) {
        std::copy_n(from, count, to);
        return;
    }
    const std::int64_t* columns = mirror->columns.data();
    const float* signs = mirror->signs.data();
    for (size_t i = 0; i < count; ++i) to[i] = from[columns[i]] * signs[i];
}

/// Whether all entries are places in an array of so many.
bool are_places(const In<std::int64_t, nb::ndim<1>>& entries, size_t count) {
    return entries.size() == count &&
           std::all_of(entries.data(), entries.data() + count, [count](std::int64_t place) {
               return place >= 0 && static_cast<size_t>(place) < count;
           });
}

}  // namespace

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
                         const In<double, nb::ndim<2>>& uniform, const Mirror* mirror) {
    const size_t drawn = count(), width = inputs(), choices = actions();
    require(size && size <= store.count() && store.inputs() == width &&
                store.actions() == choices && !store.imitated.size() == !imitated.size() &&
                uniform.shape(0) == (mirror ? 2 : 1) && uniform.shape(1) == drawn,
            "samples and numbers to draw them have other shapes");
    require(!mirror || (are_places(mirror->columns, width) && mirror->signs.size() == width &&
                        are_places(mirror->actions, choices)),
            "the reflection does not belong to these samples");
    for (size_t i = 0; i < drawn; ++i) {
        const double number = uniform.data()[i];
        require(number >= 0.0 && number < 1.0, "a number lies outside of [0, 1)");
        const auto place = static_cast<size_t>(number * static_cast<double>(size));
        const size_t row = std::min(place, size - 1);
        const Mirror* of = mirror && uniform.data()[drawn + i] >= 0.5 ? mirror : nullptr;
        copy_inputs(store.observation.data() + row * width, observation.data() + i * width, width,
                    of);
        copy_inputs(store.next_observation.data() + row * width,
                    next_observation.data() + i * width, width, of);
        reward.data()[i] = store.reward.data()[row];
        discount.data()[i] = store.discount.data()[row];
        const std::int64_t taken = store.action.data()[row];
        action.data()[i] = of ? image_of(taken, *of) : taken;
        const bool* from = store.forbidden.data() + row * choices;
        bool* to = forbidden.data() + i * choices;
        for (size_t k = 0; k < choices; ++k) to[k] = from[of ? of->actions.data()[k] : k];
        if (!imitated.size()) continue;
        const std::int64_t wanted = store.imitated.data()[row];
        imitated.data()[i] = of ? image_of(wanted, *of) : wanted;
    }
}

void bind_replay(nb::module_& module) {
    nb::class_<Mirror>(module, "Mirror", "A reflection of inputs and actions.")
        .def(nb::init<In<std::int64_t, nb::ndim<1>>, In<float, nb::ndim<1>>,
                      In<std::int64_t, nb::ndim<1>>>(),
             nb::arg("columns"), nb::arg("signs"), nb::arg("actions"));
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
             nb::arg("mirror").none(),
             "Replace all samples by samples of `store`, one of its first `size` for each number "
             "uniform[0, i] in [0, 1), and by its mirror image where uniform[1, i] >= 1/2.");
}

}  // namespace serp
