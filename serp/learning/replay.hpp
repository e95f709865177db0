// Samples of the replay memory in NumPy arrays, and batches drawn from them.
#pragma once

#include "serp/_util/arrays.hpp"

namespace serp {

/// A reflection as `serp.learning.reflection.Reflection` has it: F columns and signs, A actions.
struct Mirror {
    In<std::int64_t, nb::ndim<1>> columns;
    In<float, nb::ndim<1>> signs;
    In<std::int64_t, nb::ndim<1>> actions;
};

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
    /// its first `size`. Where the second number of a sample, if there are any, is 1/2 or more, the
    /// sample is replaced by its mirror image.
    void draw(const ReplaySamples& store, size_t size, const In<double, nb::ndim<2>>& uniform,
              const Mirror* mirror);

    Rows observation;
    Actions action;
    Numbers reward;
    Rows next_observation;
    Numbers discount;
    Out<bool, nb::ndim<2>> forbidden;
    Actions imitated;
};

}  // namespace serp
