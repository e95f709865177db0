// The counted outcomes of an action: what they predict, and how probable they are.
//
// An outcome is what the file predicts for the action, what it predicts for another action with the
// same arguments (a robot that slips; walls and conditions of the file hold then, too), or a change
// of the state. Outcomes are counted over all states and in contexts: states with the same
// predicates and whole numbers.
#pragma once

#include <cstdint>
#include <unordered_map>
#include <vector>

#include "serp/model/flags.hpp"
#include "serp/model/learned/file_step.hpp"
#include "serp/model/learned/regression.hpp"

namespace serp {

/// Most outcomes of an action that are distinguished; outcome 0 is the file's prediction.
inline constexpr int KINDS = 12;
/// Less likely outcomes are left out of predictions.
inline constexpr double RARE = 1e-3;

/// How an outcome fits an observation; one without a prediction is impossible.
enum class Fit { IMPOSSIBLE, POSSIBLE, FITS };

/// Scratch memory for the outcomes of one step: one for each thread.
struct OutcomeRoom {
    explicit OutcomeRoom(int width)
        : probabilities(KINDS), values(static_cast<std::size_t>(KINDS) * width), step(width + 1),
          fits(KINDS), ends(KINDS) {}

    std::vector<double> probabilities;  ///< [KINDS]
    std::vector<double> values;         ///< [kinds, columns] the counted fluents as predicted
    std::vector<double> step;           ///< [F + 1] a state and reward
    std::vector<Fit> fits;              ///< [KINDS]
    std::vector<char> ends;             ///< [KINDS] whether an outcome ends the episode
};

/// A step whose outcomes are to be predicted.
struct OutcomeStep {
    FileStep& file;                  ///< starts from the state
    int action;                      ///< the ground action
    const std::vector<int>& inputs;  ///< columns of the feature group in a state
    const double* state;             ///< [F]
    const double* flowed;            ///< [F] it after effects, processes and residual
};

/// Counts of the outcomes of the ground actions that share the key of a feature group.
///
/// `inputs` are the columns of a feature group in a state; the table has positions within them.
class OutcomeTable {
public:
    static constexpr int EXPERTS = 4;   ///< the last one counts over all contexts alone
    static constexpr int CHANGE = -1;   ///< in place of an action schema: the outcome is a change
    static constexpr int ROWS = 2048;   ///< most contexts, plus one
    static constexpr int SETS = 64;     ///< most sets of outcomes; the rarest one makes room
    /// Probability that an observation is taken to have had at least; least trust in an expert.
    static constexpr double LEAST = 1e-6;

    /// An empty table for the counted fluents, and those of a context: positions within the inputs,
    /// in ascending order. Throws std::invalid_argument where they are not.
    OutcomeTable(std::vector<int> places, std::vector<int> context);

    int columns() const { return static_cast<int>(places_.size()); }

    /// Throws std::invalid_argument where the table does not fit inputs in states of F fluents, or
    /// has outcomes of unknown schemas. Predictions and `count` rely on it.
    void check(const std::vector<int>& inputs, int width, int known_schemas) const;

    /// Computes the probabilities of the outcomes of a step, no two of which predict the same, and
    /// returns the likeliest; `put` applies one.
    int likeliest(const OutcomeStep& step, OutcomeRoom& room) const;

    /// Sets the counted fluents in `out` [F] as an outcome predicts, after `likeliest`.
    void put(int kind, const std::vector<int>& inputs, const OutcomeRoom& room, double* out) const;

    /// Updates the scores with a new sample, of which there were so many, and then counts it.
    ///
    /// Returns false where it is no outcome, and there is no room for another.
    bool count(ObservedStep& seen, const std::vector<int>& inputs, double samples,
               OutcomeRoom& room);

    /// Counts samples that were as in the file, before all others.
    void start(double samples);

    /// Returns a table with the same outcomes, "nothing changes" among them, and no counts.
    OutcomeTable emptied() const;

    /// Uses so many outcomes, sets and rows of the arrays below. Throws std::invalid_argument where
    /// their numbers do not fit each other.
    void restore(int new_kinds, int new_sets, int new_rows);

    /// [2] moving averages of the Brier scores (Monthly Weather Review 78, 1950) of the file and of
    /// the counts.
    Block<double> scores{2};
    int kinds = 1, sets = 0, rows = 1;     ///< outcomes, sets of these and rows of counts in use
    Block<std::int64_t> schemas{KINDS};    ///< [KINDS] whose effect an outcome is, or CHANGE
    Block<double> changes;                 ///< [KINDS, columns]
    Block<double> trust{EXPERTS};          ///< [EXPERTS]
    /// [SETS] outcomes that explained observations together, as bits; and of how many observations.
    Block<std::int64_t> members{SETS};
    Block<double> numbers{SETS};
    /// [ROWS] hash of the context, below 2^53; row 0 counts over all states.
    Block<double> codes{ROWS};
    Block<double> counts{ROWS, KINDS};     ///< [ROWS, KINDS]
    Block<double> totals{ROWS};            ///< [ROWS] their sums
    Block<double> evidence{ROWS, EXPERTS}; ///< [ROWS, EXPERTS]

private:
    const double* values_of(const OutcomeRoom& room, int kind) const;
    double code_of(const std::vector<int>& inputs, const double* state) const;
    int row_of(const std::vector<int>& inputs, const double* state) const;
    int find_or_enter(const std::vector<int>& inputs, const double* state);

    void fill_broadest(double* probabilities) const;
    void refine(int row, double* probabilities) const;
    void weigh_experts(int row, const OutcomeRoom& room);

    bool predict(const OutcomeStep& step, int kind, std::int64_t schema, OutcomeRoom& room) const;
    bool alike(const OutcomeRoom& room, int kind, int other) const;
    void merge(OutcomeRoom& room) const;

    void compare(const OutcomeStep& step, const ObservedStep& seen, int kind,
                 OutcomeRoom& room) const;
    int fit_all(const OutcomeStep& step, const ObservedStep& seen, OutcomeRoom& room) const;
    int find_new(const OutcomeStep& step, const ObservedStep& seen, OutcomeRoom& room);
    double score(const OutcomeRoom& room) const;
    void add(int row, OutcomeRoom& room);
    void add_share(int row, int kind, double share);
    void count_set(int of_set);
    void share_sets();

    std::vector<int> places_, context_;
    std::unordered_map<std::int64_t, int> row_of_code_;
};

}  // namespace serp
