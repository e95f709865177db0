// The model as the file has it.
#pragma once

#include <memory>
#include <vector>

#include "serp/model/model.hpp"
#include "serp/model/program.hpp"

namespace serp {

/// A program with parameters theta [P] and a control period dt.
class WrittenModel : public Model {
public:
    /// Throws std::invalid_argument where theta has another length or a number is not usable.
    WrittenModel(std::shared_ptr<const Program> program, std::vector<double> theta, double dt);

    int fluents() const override { return program_->fluents(); }
    int actions() const override { return program_->actions(); }
    std::unique_ptr<Stepper> stepper() const override;
    bool branches() const override { return program_->branches(); }

    /// The outcome of an action that predicts an observed next state [F] best; the likeliest of equals.
    int likeliest_outcome(const double* state, int action, const double* next_state) const;

    const std::shared_ptr<const Program>& program() const { return program_; }
    const std::vector<double>& theta() const { return theta_; }
    double dt() const { return dt_; }

private:
    std::shared_ptr<const Program> program_;
    std::vector<double> theta_;
    double dt_;
};

}  // namespace serp
