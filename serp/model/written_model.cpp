#include "serp/model/written_model.hpp"

#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/shared_ptr.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "serp/_util/arrays.hpp"

namespace serp {

namespace {

class WrittenStepper : public Stepper {
public:
    explicit WrittenStepper(const WrittenModel& model)
        : program_(model.program()), registers_(program_->registers()) {
        program_->prepare(model.theta().data(), model.dt(), registers_.data());
    }

    void from(const double* state) override { program_->from(state, registers_.data()); }

    Flags step(int action, double* out) override {
        if (program_->outcomes(action) == 1) return program_->step(action, out, registers_.data());
        rows_.resize(static_cast<size_t>(OUTCOMES * (program_->fluents() + 3)));
        const int fluents = program_->fluents(), count = outcomes(action, rows_.data());
        const auto first = static_cast<Flags>(rows_[fluents + 1]);
        if (!(first & APPLICABLE)) return first;
        bool certain = true;
        for (int k = 0; k < count; ++k) {
            certain = certain && static_cast<Flags>(rows_[k * (fluents + 3) + fluents + 1]) & UNSAFE;
        }
        return joint(rows_.data(), count, fluents, certain, out);
    }

    Steps steps(const double* states, int count) override {
        if (program_->branches())
            return each_step(states, program_->actions(), program_->fluents());
        if (count >= Lanes::FEW && lanes_.states < 0)
            program_->prepare(registers_.data(), lanes_);
        if (count < Lanes::FEW || lanes_.states == 0)
            return each_step(states, program_->actions(), program_->fluents());
        return program_->steps(states, count, lanes_);
    }

    int outcomes(int action, double* rows) override {
        const int fluents = program_->fluents(), row = fluents + 3;
        if (program_->outcomes(action) == 1) return only_outcome(action, rows, fluents);
        const int count = program_->outcomes(action);
        for (int k = 0; k < count; ++k) {
            double* to = rows + k * row;
            const Flags flags = program_->step(program_->variant(action, k), to, registers_.data());
            to[fluents + 1] = static_cast<double>(flags);
            to[fluents + 2] = program_->chance(action, k);
            if (!(flags & APPLICABLE)) {  // a step without a result must not count as safe
                if (k > 0) std::copy_n(to, row, rows);
                rows[fluents + 2] = 1.0;
                return 1;
            }
        }
        return count;
    }

private:
    const std::shared_ptr<const Program> program_;
    std::vector<double> registers_, rows_;
    Lanes lanes_;
};

}  // namespace

WrittenModel::WrittenModel(std::shared_ptr<const Program> program, std::vector<double> theta,
                           double dt)
    : program_(std::move(program)), theta_(std::move(theta)), dt_(dt) {
    const auto finite = [](double number) { return std::isfinite(number); };
    if (theta_.size() != static_cast<size_t>(program_->parameters()) ||
        !std::all_of(theta_.begin(), theta_.end(), finite))
        throw std::invalid_argument("theta must be " + std::to_string(program_->parameters()) +
                                    " finite numbers");
    if (!(dt > 0.0) || !std::isfinite(dt))
        throw std::invalid_argument("the control period must be a positive number");
}

int WrittenModel::likeliest_outcome(const double* state, int action,
                                    const double* next_state) const {
    const int count = program_->outcomes(action), width = program_->fluents();
    if (count == 1) return 0;
    std::vector<double> out(width + 1), registers(program_->registers());
    program_->prepare(theta_.data(), dt_, registers.data());
    program_->from(state, registers.data());
    int best = 0;
    double least = std::numeric_limits<double>::infinity();
    for (int k = 0; k < count; ++k) {
        const int variant = program_->variant(action, k);
        if (!(program_->step(variant, out.data(), registers.data()) & APPLICABLE)) continue;
        double error = 0.0;
        for (int f = 0; f < width; ++f) error = std::max(error, std::abs(out[f] - next_state[f]));
        if (error < least) {
            best = k;
            least = error;
        }
    }
    return best;
}

std::unique_ptr<Stepper> WrittenModel::stepper() const {
    return std::make_unique<WrittenStepper>(*this);
}

// For Python ---------------------------------------------------------------------------------------

namespace {

using State = In<double, nb::ndim<1>>;
using States = In<double, nb::ndim<2>>;
/// Next state and reward [F + 1], and flags.
using Result = std::pair<Array<double>, Flags>;

const double* state_of(const Model& model, const State& state) {
    if (state.size() != static_cast<size_t>(model.fluents()))
        throw std::invalid_argument("a state of this model must have " +
                                    std::to_string(model.fluents()) + " numbers");
    return state.data();
}

int action_of(const Model& model, std::int64_t action, int least = 0) {
    if (action < least || action >= model.actions())
        throw std::invalid_argument("there is no action " + std::to_string(action));
    return static_cast<int>(action);
}

Result result_of(std::vector<double>&& out, Flags flags) {
    const size_t size = out.size();
    return {array_of(std::move(out), {size}), flags};
}

Result step_of(const Model& model, const State& state, std::int64_t action, int least) {
    std::vector<double> out(model.fluents() + 1);
    const auto stepper = model.stepper();
    stepper->from(state_of(model, state));
    const Flags flags = stepper->step(action_of(model, action, least), out.data());
    return result_of(std::move(out), flags);
}

/// Steps of a batch: next states and rewards [B, F + 1], and flags [B].
std::pair<Array<double>, Array<Flags>> step_batch(const Model& model, const States& states,
                                                  const In<std::int64_t, nb::ndim<1>>& actions) {
    const size_t batch = states.shape(0), width = static_cast<size_t>(model.fluents());
    if (states.shape(1) != width || actions.size() != batch)
        throw std::invalid_argument("the shapes of states and actions do not fit the model");
    std::vector<int> checked(batch);
    for (size_t k = 0; k < batch; ++k) checked[k] = action_of(model, actions.data()[k]);
    std::vector<double> out(batch * (width + 1));
    std::vector<Flags> flags(batch);
    const auto stepper = model.stepper();
    for (size_t k = 0; k < batch; ++k) {
        stepper->from(states.data() + k * width);
        flags[k] = stepper->step(checked[k], out.data() + k * (width + 1));
    }
    return {array_of(std::move(out), {batch, width + 1}), array_of(std::move(flags), {batch})};
}

/// Steps of all actions from states: next states and rewards [B, A, F + 1], flags [B, A], and of each
/// the probability [B, A] of what the file says where something else is likelier, and that state
/// [B, A, F + 1].
std::tuple<Array<double>, Array<Flags>, Array<double>, Array<double>> steps_of(const Model& model,
                                                                               const States& states) {
    const size_t batch = states.shape(0), width = static_cast<size_t>(model.fluents());
    const size_t actions = static_cast<size_t>(model.actions());
    if (states.shape(1) != width)
        throw std::invalid_argument("the shape of the states does not fit the model");
    std::vector<double> rows(batch * (width + 1)), out(batch * actions * (width + 1));
    std::vector<double> chances(batch * actions), written(out.size());
    for (size_t k = 0; k < batch; ++k)
        std::copy_n(states.data() + k * width, width, rows.data() + k * (width + 1));
    std::vector<Flags> flags(batch * actions);
    const auto stepper = model.stepper();
    for (size_t state = 0; state < batch;) {
        const Steps steps =
            stepper->steps(rows.data() + state * (width + 1), static_cast<int>(batch - state));
        for (int k = 0; k < steps.states; ++k, ++state)
            for (size_t action = 0; action < actions; ++action) {
                const size_t to = state * actions + action, lane = action * steps.apart + k;
                flags[to] = steps.flags[lane];
                chances[to] = steps.chances ? steps.chances[lane] : 0.0;
                if (chances[to] > 0.0)
                    std::copy_n(steps.written + lane * steps.lane, width, &written[to * (width + 1)]);
                for (size_t f = 0; f <= width; ++f)
                    out[to * (width + 1) + f] = steps.numbers[lane * steps.lane + f * steps.row];
            }
    }
    return {array_of(std::move(out), {batch, actions, width + 1}),
            array_of(std::move(flags), {batch, actions}),
            array_of(std::move(chances), {batch, actions}),
            array_of(std::move(written), {batch, actions, width + 1})};
}

Array<double> outcomes_of(const Model& model, const State& state, std::int64_t action) {
    const size_t width = static_cast<size_t>(model.fluents()) + 3;
    std::vector<double> rows(OUTCOMES * width);
    const auto stepper = model.stepper();
    stepper->from(state_of(model, state));
    const auto count = static_cast<size_t>(stepper->outcomes(action_of(model, action), rows.data()));
    rows.resize(count * width);
    return array_of(std::move(rows), {count, width});
}

Array<double> uncertainty_of(const Model& model, const State& state) {
    std::vector<double> found(model.actions());
    const auto stepper = model.stepper();
    stepper->from(state_of(model, state));
    for (int action = 0; action < model.actions(); ++action)
        found[action] = stepper->uncertainty(action);
    const size_t count = found.size();
    return array_of(std::move(found), {count});
}

std::shared_ptr<Program> program_of(const In<std::uint32_t, nb::shape<-1, 4>>& code,
                                    const In<std::uint32_t, nb::ndim<1>>& entries, int fluents,
                                    int parameters, int intermediate,
                                    const In<std::uint32_t, nb::ndim<1>>& first_chance,
                                    const In<double, nb::ndim<1>>& chances) {
    static_assert(sizeof(Instruction) == 4 * sizeof(std::uint32_t));
    std::vector<Instruction> table(code.shape(0));
    if (!table.empty()) std::memcpy(table.data(), code.data(), code.nbytes());
    return std::make_shared<Program>(std::move(table), vector_of(entries), fluents, parameters,
                                     intermediate, vector_of(first_chance), vector_of(chances));
}

Result step_of_outcome(const WrittenModel& model, const State& state, std::int64_t action,
                       std::int64_t outcome) {
    const Program& program = *model.program();
    const int acted = action_of(model, action);
    if (outcome < 0 || outcome >= program.outcomes(acted))
        throw std::invalid_argument("there is no outcome " + std::to_string(outcome));
    std::vector<double> out(model.fluents() + 1), registers(program.registers());
    program.prepare(model.theta().data(), model.dt(), registers.data());
    program.from(state_of(model, state), registers.data());
    const int variant = program.variant(acted, static_cast<int>(outcome));
    const Flags flags = program.step(variant, out.data(), registers.data());
    return result_of(std::move(out), flags);
}

Result judgement_of(const WrittenModel& model, const State& state, std::int64_t action,
                    const State& next_state) {
    const Program& program = *model.program();
    std::vector<double> out(model.fluents() + 1), registers(program.registers());
    const double *from = state_of(model, state), *to = state_of(model, next_state);
    const int acted = action_of(model, action, -1);
    const int variant = program.variant(acted, model.likeliest_outcome(from, acted, to));
    const Flags flags = program.judge(from, variant, to, model.theta().data(), model.dt(),
                                      out.data(), registers.data());
    return result_of(std::move(out), flags);
}

}  // namespace

void bind_model(nb::module_& module) {
    nb::class_<Program>(module, "Program", "The instruction table of a ground model.")
        .def(nb::new_(&program_of), nb::arg("code"), nb::arg("entries"), nb::arg("fluents"),
             nb::arg("parameters"), nb::arg("intermediate"), nb::arg("first_chance"),
             nb::arg("chances"),
             "Check a table: instructions [n, 4], where the parts begin [3 + 2(A + O)]: drift, "
             "settle, aftermath, the actions and their further outcomes, these judged; and from "
             "first_chance [A + 1] on the chances of the outcomes of each action [A + O].");

    nb::class_<Model>(module, "Model", "A transition model as planners take it.")
        .def_prop_ro("fluents", &Model::fluents)
        .def_prop_ro("actions", &Model::actions)
        .def("step", [](const Model& model, const State& state, std::int64_t action) {
                return step_of(model, state, action, 0);
            }, nb::arg("state"), nb::arg("action"),
            "Return next state and reward [F + 1], and the flags.")
        .def("step_batch", &step_batch, nb::arg("states"), nb::arg("actions"),
             "Return next states and rewards [B, F + 1], and the flags [B].")
        .def("steps", &steps_of, nb::arg("states"),
             "Return next states and rewards [B, A, F + 1] of all actions, the flags [B, A], and, where\n"
             "something is likelier than what the file says, its probability [B, A] and that state.")
        .def("outcomes", &outcomes_of, nb::arg("state"), nb::arg("action"),
             "Return the outcomes of a step: next state, reward, flags and probability [n, F + 3].")
        .def("uncertainty", &uncertainty_of, nb::arg("state"),
             "Return how far each action is from the data [A].");

    nb::class_<WrittenModel, Model>(module, "WrittenModel", "The model as the file has it.")
        .def(nb::new_([](std::shared_ptr<Program> program, const State& theta, double dt) {
                 return std::make_shared<WrittenModel>(std::move(program), vector_of(theta), dt);
             }), nb::arg("program"), nb::arg("theta"), nb::arg("dt"))
        .def("step", [](const WrittenModel& model, const State& state, std::int64_t action) {
                return step_of(model, state, action, -1);
            }, nb::arg("state"), nb::arg("action"),
            "Return next state and reward [F + 1], and the flags; action -1 is none.")
        .def("step_of_outcome", &step_of_outcome, nb::arg("state"), nb::arg("action"),
             nb::arg("outcome"), "Return `step` with one of the outcomes of an action, from 0.")
        .def("outcome_of", [](const WrittenModel& model, const State& state, std::int64_t action,
                              const State& next_state) {
                return model.likeliest_outcome(state_of(model, state), action_of(model, action, -1),
                                               state_of(model, next_state));
            }, nb::arg("state"), nb::arg("action"), nb::arg("next_state"),
            "Return the outcome of an action that predicts an observed next state best.")
        .def("judge", &judgement_of, nb::arg("state"), nb::arg("action"), nb::arg("next_state"),
             "Return the observed next state after events, then its reward [F + 1], and the flags.");
}

}  // namespace serp
