// The adapted model: the step of the file with parameters in use and learned parts.
#pragma once

#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "serp/model/learned/file_step.hpp"
#include "serp/model/learned/outcome_counts.hpp"
#include "serp/model/learned/regression.hpp"
#include "serp/model/model.hpp"
#include "serp/model/written_model.hpp"

namespace serp {

/// What is learned of the feature groups of one key, and shared by them. It may change at any time
/// between decisions.
struct GroupParameters {
    GroupParameters(std::shared_ptr<Regression> regression, int head)
        : regression(std::move(regression)), head(head) {}

    std::shared_ptr<Regression> regression;  ///< of the residual; none: too many inputs to learn
    int head;                                ///< of the action schema in the regression
    std::shared_ptr<OutcomeTable> outcomes;  ///< the counts in use, or none

    bool counted() const { return outcomes != nullptr; }
    /// Whether the residual is in use.
    bool corrected() const { return regression && regression->most() != FILE_ALONE; }

    // What the outcomes must fit, see `OutcomeTable::check`.
    std::vector<int> inputs;
    int width = 0, schemas = 0;
    bool owned = false;  ///< by a model
};

/// A feature group of a ground action.
struct FeatureGroup {
    std::vector<int> inputs;   ///< columns that the change may depend on
    std::vector<int> targets;  ///< columns of the numbers that may change
    std::shared_ptr<GroupParameters> shared;
    int place = 0;  ///< equal for groups of one regression with the same inputs
};

/// A transition model that is adapted to observed transitions; its step is described in
/// `serp.model.learned.adapted_model.AdaptedModel`.
class AdaptedModel : public Model {
public:
    /// `flagging`: whether events can make `unsafe` true, or a step can end without a result in events,
    /// goal or metric. `worth`, if any, is the regression of
    /// reward and end: a head for each action; inputs are all fluents, then reward and end as
    /// predicted without it. Throws std::invalid_argument where the parts do not fit each other.
    AdaptedModel(std::shared_ptr<const WrittenModel> written, SameArguments others, bool flagging,
                 std::vector<std::vector<FeatureGroup>> groups, std::shared_ptr<Regression> worth);

    int fluents() const override { return written_->fluents(); }
    int actions() const override { return written_->actions(); }
    std::unique_ptr<Stepper> stepper() const override;
    bool branches() const override;

    /// Whether anything adapted is in use.
    bool active() const;
    /// Whether counts of outcomes are used in the step of an action.
    bool counted(int action) const;
    /// Whether a residual is used in the step of an action.
    bool corrected(int action) const;

    /// The regression of reward and end in use, or null.
    const Regression* worth() const {
        return worth_ && worth_->most() != FILE_ALONE ? worth_.get() : nullptr;
    }

    /// Uses parameters [P] from now on.
    void adopt(const std::vector<double>& parameters);
    const std::vector<double>& parameters() const { return parameters_; }
    /// Whether parameters in use differ from those written.
    bool revised() const { return revised_; }
    /// How often parameters were adopted.
    int adoptions() const { return adoptions_; }

    const WrittenModel& written() const { return *written_; }
    bool flagging() const { return flagging_; }
    const std::vector<FeatureGroup>& groups(int action) const { return groups_[action]; }
    /// Number of `FeatureGroup::place`s.
    int places() const { return places_; }

    /// The step of the file with the parameters in use now; valid while the model exists.
    FileStep file_step() const {
        return FileStep(*written_->program(), parameters_.data(), written_->dt(), others_);
    }
    /// The step of the file as written.
    FileStep written_step() const {
        return FileStep(*written_->program(), written_->theta().data(), written_->dt(), others_);
    }

    /// Notes in an observed step what is expected of its reward and end. Not thread-safe.
    void weigh(ObservedStep& step) const;

private:
    void place_groups();

    std::shared_ptr<const WrittenModel> written_;
    std::vector<double> parameters_;
    bool revised_ = false;
    int adoptions_ = 0;
    SameArguments others_;
    bool flagging_;
    std::vector<std::vector<FeatureGroup>> groups_;  ///< of each action
    std::vector<std::shared_ptr<GroupParameters>> shared_;
    std::shared_ptr<Regression> worth_;
    mutable std::unique_ptr<Stepper> observer_;  ///< of `weigh`
    int places_ = 0;
};

}  // namespace serp
