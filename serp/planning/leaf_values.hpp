// The values of the states where a lookahead ends.
#pragma once

namespace serp {

/// Values of states. `at` may be called from several threads at once.
class LeafValues {
public:
    virtual ~LeafValues() = default;

    /// Returns the value of a state [F].
    /// Returns F.
    virtual int width() const = 0;
    virtual double at(const double* state) const = 0;
};

}  // namespace serp
