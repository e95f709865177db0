// Samples of the replay memory in NumPy arrays, and batches drawn from them.
#pragma once

#include "serp/_util/arrays.hpp"

namespace serp {

/// N samples; `serp.learning.replay.Samples` describes the fields. `imitated` may have no rows.
class ReplaySamples {
public:
    using Rows = Out<float, nb::ndim<2>>;
    using Numbers = Out<float, nb::ndim<1>>;
    using Actions = Out<std::int64_t, nb::ndim<1>>;

    ReplaySamples(Rows observation, Actions action, Numbers reward, Rows next_observation,
                  Numbers discount, Out<bool, nb::ndim<2>> forbidden, Actions imitated);

    size_t count() const { return action.size(); }
    size_t inputs() const { return observation.shape(1); }
    size_t actions() const { return forbidden.shape(1); }

    /// Replaces all samples by samples of `store`, for each a number in [0, 1) that chooses one of
    /// its first `size`.
    void draw(const ReplaySamples& store, size_t size, const In<double, nb::ndim<1>>& uniform);

    Rows observation;
    Actions action;
    Numbers reward;
    Rows next_observation;
    Numbers discount;
    Out<bool, nb::ndim<2>> forbidden;
    Actions imitated;
};

}  // namespace serp
