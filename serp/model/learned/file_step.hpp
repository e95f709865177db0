// The step of the file with the parameters in use, as the learned parts of a model see it.
#pragma once

#include <vector>

#include "serp/model/program.hpp"

namespace serp {

/// Which ground actions of other schemas have the same arguments.
struct SameArguments {
    int schemas = 0;
    std::vector<int> action;  ///< [A * S], -1 where there is none and for the action itself

    int actions() const { return schemas > 0 ? static_cast<int>(action.size()) / schemas : 0; }
    int of(int ground_action, int schema) const { return action[ground_action * schemas + schema]; }
};

/// Effects and processes, then events, with the parameters in use. Has scratch memory: one for each
/// thread.
class FileStep {
public:
    FileStep(const Program& program, const double* theta, double dt, const SameArguments& others)
        : program_(program), theta_(theta), dt_(dt), others_(others),
          registers_(program.registers()) {}

    int width() const { return program_.fluents(); }
    const SameArguments& others() const { return others_; }

    /// Writes state [F] and reward after effects and processes; see `Program::flow`.
    Flags flow(const double* state, int action, double* out) {
        return program_.flow(state, action, theta_, dt_, out, registers_.data());
    }

    /// Applies events to what `flow` wrote; see `Program::settle`.
    Flags settle(const double* state, Flags flags, double* out) {
        return program_.settle(state, flags, theta_, dt_, out, registers_.data());
    }

private:
    const Program& program_;
    const double* theta_;
    double dt_;
    const SameArguments& others_;
    std::vector<double> registers_;
};

}  // namespace serp
