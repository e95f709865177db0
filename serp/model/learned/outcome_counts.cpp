#include "serp/model/learned/outcome_counts.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>
#include <utility>

#include "serp/_util/arrays.hpp"
#include "serp/_util/checks.hpp"

namespace serp {

namespace {

/// Samples that the counts over all contexts are worth, of the experts that count in a context.
constexpr std::array PRIORS{0.1, 1.0, 10.0};
/// Weight of the past in the scores and in the evidence for an expert, per sample.
constexpr double PAST = 0.995;
/// Counts of a context are halved beyond this total.
constexpr double MOST = 2000.0;
/// Steps of expectation-maximisation after a sample; they go on from where the last ones ended.
constexpr int ITERATIONS = 10;
/// Codes of contexts are below it, so that a float64 holds them exactly.
constexpr double CODES = 9007199254740992.0;

/// Returns the whole part of a number, and the least integer for what is none or too large.
std::int64_t whole(double number) {
    const bool fits = number >= -9223372036854775808.0 && number < 9223372036854775808.0;
    return fits ? static_cast<std::int64_t>(number) : std::numeric_limits<std::int64_t>::min();
}

bool ascending(const std::vector<int>& positions) {
    return std::adjacent_find(positions.begin(), positions.end(), std::greater_equal<int>()) ==
               positions.end() &&
           (positions.empty() || positions.front() >= 0);
}

}  // namespace

OutcomeTable::OutcomeTable(std::vector<int> places, std::vector<int> context)
    : changes(KINDS, places.size()), places_(std::move(places)), context_(std::move(context)) {
    require(ascending(places_) && ascending(context_), "positions are not in ascending order");
    schemas[0] = CHANGE;
    trust.fill(1.0);
    evidence.fill(1.0);
}

void OutcomeTable::check(const std::vector<int>& inputs, int width, int known_schemas) const {
    const int depth = static_cast<int>(inputs.size());
    require((places_.empty() || places_.back() < depth) &&
                (context_.empty() || context_.back() < depth),
            "counted fluents lie beyond the inputs");
    require(columns() <= width, "more counted fluents than fluents");
    for (const int column : inputs) require(0 <= column && column < width, "inputs out of range");
    for (int kind = 0; kind < kinds; ++kind) {
        require(CHANGE <= schemas[kind] && schemas[kind] < known_schemas,
                "outcomes of unknown action schemas");
    }
}

// Contexts ----------------------------------------------------------------------------------------

/// Returns a hash of the context of a state (FNV-1a, folded), a whole number below 2^53.
double OutcomeTable::code_of(const std::vector<int>& inputs, const double* state) const {
    std::uint64_t code = 0xCBF29CE484222325;
    for (const int place : context_) {
        code = (code ^ static_cast<std::uint64_t>(whole(state[inputs[place]]))) * 0x100000001B3;
        code ^= code >> 29;
    }
    return static_cast<double>(code >> 11);
}

/// Returns the row of a state's context; 0 for an unknown one.
int OutcomeTable::row_of(const std::vector<int>& inputs, const double* state) const {
    const auto found = row_of_code_.find(static_cast<std::int64_t>(code_of(inputs, state)));
    return found == row_of_code_.end() ? 0 : found->second;
}

/// Returns `row_of` a context, after adding a row for an unknown one while there is room.
int OutcomeTable::find_or_enter(const std::vector<int>& inputs, const double* state) {
    const int row = row_of(inputs, state);
    if (row != 0 || rows == ROWS) return row;
    codes[rows] = code_of(inputs, state);
    row_of_code_.emplace(static_cast<std::int64_t>(codes[rows]), rows);
    return rows++;
}

// Probabilities -----------------------------------------------------------------------------------

/// Computes the probability of each outcome over all contexts; the file's before any sample.
void OutcomeTable::fill_broadest(double* probabilities) const {
    for (int kind = 0; kind < kinds; ++kind) {
        probabilities[kind] = totals[0] > 0.0 ? counts[kind] / totals[0] : 0.0;
    }
    if (totals[0] <= 0.0) probabilities[0] = 1.0;
}

/// Turns the probabilities over all contexts into those of a row; row 0 has the same.
void OutcomeTable::refine(int row, double* probabilities) const {
    if (row == 0) return;
    const double *own = &counts[row * KINDS], *believed = &evidence[row * EXPERTS];
    double weights = trust[EXPERTS - 1] * believed[EXPERTS - 1];
    double counted = 0.0, broader = weights;
    for (std::size_t e = 0; e < PRIORS.size(); ++e) {
        const double weight = trust[e] * believed[e];
        weights += weight;
        counted += weight / (totals[row] + PRIORS[e]);
        broader += weight * PRIORS[e] / (totals[row] + PRIORS[e]);
    }
    for (int kind = 0; kind < kinds; ++kind) {
        const double mixed = counted * own[kind] + broader * probabilities[kind];
        probabilities[kind] = mixed / weights;
    }
}

/// Updates the evidence for the experts of a row by an observation that the outcomes in the room
/// fit; the probabilities in the room are those over all contexts.
void OutcomeTable::weigh_experts(int row, const OutcomeRoom& room) {
    if (row == 0) return;
    const double* own = &counts[row * KINDS];
    double* believed = &evidence[row * EXPERTS];
    double fitting = 0.0, possible = 0.0, told = 0.0, known = 0.0;
    for (int kind = 0; kind < kinds; ++kind) {
        if (room.fits[kind] == Fit::IMPOSSIBLE) continue;
        possible += room.probabilities[kind];
        known += own[kind];
        if (room.fits[kind] == Fit::FITS) {
            fitting += room.probabilities[kind];
            told += own[kind];
        }
    }
    if (possible <= 0.0) return;
    fitting /= possible;
    double most = 0.0, total = 0.0;
    for (std::size_t e = 0; e < EXPERTS; ++e) {
        double predicted = fitting;
        if (e < PRIORS.size()) predicted = (told + PRIORS[e] * fitting) / (known + PRIORS[e]);
        believed[e] = std::pow(believed[e], PAST) * std::max(LEAST, predicted);
        most = std::max(most, believed[e]);
    }
    for (std::size_t e = 0; e < EXPERTS; ++e) {
        believed[e] = std::max(LEAST, believed[e] / most);
        total += trust[e] * believed[e];
    }
    for (std::size_t e = 0; e < EXPERTS; ++e) {
        const double share = trust[e] * believed[e] / total;
        trust[e] = std::max(LEAST, PAST * trust[e] + share);
    }
}

// Predictions -------------------------------------------------------------------------------------

const double* OutcomeTable::values_of(const OutcomeRoom& room, int kind) const {
    return room.values.data() + kind * columns();
}

/// Writes what an outcome of a schema predicts to the room; returns whether it is possible.
bool OutcomeTable::predict(const OutcomeStep& step, int kind, std::int64_t schema,
                           OutcomeRoom& room) const {
    double* values = room.values.data() + kind * columns();
    if (kind == 0 || schema == CHANGE) {
        const double* change = changes.data() + kind * columns();
        for (int k = 0; k < columns(); ++k) {
            const int column = step.inputs[places_[k]];
            values[k] = kind == 0 ? step.flowed[column] : step.state[column] + change[k];
        }
        return true;
    }
    const int other = step.file.others().of(step.action, schema);
    if (other < 0 || !(step.file.usual_flow(other, room.step.data()) & APPLICABLE)) return false;
    for (int k = 0; k < columns(); ++k) values[k] = room.step[step.inputs[places_[k]]];
    return true;
}

void OutcomeTable::put(int kind, const std::vector<int>& inputs, const OutcomeRoom& room,
                       double* out) const {
    const double* values = values_of(room, kind);
    for (int k = 0; k < columns(); ++k) out[inputs[places_[k]]] = values[k];
}

/// Returns whether two outcomes predict the same.
bool OutcomeTable::alike(const OutcomeRoom& room, int kind, int other) const {
    const double* values = values_of(room, kind);
    return std::equal(values, values + columns(), values_of(room, other));
}

/// Gives the probability of outcomes that predict the same to the first of them.
void OutcomeTable::merge(OutcomeRoom& room) const {
    std::vector<double>& probabilities = room.probabilities;
    for (int kind = 1; kind < kinds; ++kind) {
        for (int other = 0; other < kind; ++other) {
            const bool both = probabilities[kind] > 0.0 && probabilities[other] > 0.0;
            if (both && alike(room, kind, other)) {
                probabilities[other] += probabilities[kind];
                probabilities[kind] = 0.0;
            }
        }
    }
}

int OutcomeTable::likeliest(const OutcomeStep& step, OutcomeRoom& room) const {
    std::vector<double>& probabilities = room.probabilities;
    fill_broadest(probabilities.data());
    refine(row_of(step.inputs, step.state), probabilities.data());
    double left = 0.0;
    for (int kind = 0; kind < kinds; ++kind) {
        const bool usual = kind == 0 || probabilities[kind] >= RARE;
        if (!usual || !predict(step, kind, schemas[kind], room)) probabilities[kind] = 0.0;
        left += probabilities[kind];
    }
    if (left <= RARE) probabilities[0] = left = 1.0;
    merge(room);
    int best = 0;
    for (int kind = 0; kind < kinds; ++kind) {
        probabilities[kind] /= left;
        if (probabilities[kind] > probabilities[best]) best = kind;
    }
    return best;
}

// Counting ----------------------------------------------------------------------------------------

/// Writes how an outcome that the room has a prediction of fits, after events; and whether it is an
/// end.
void OutcomeTable::compare(const OutcomeStep& step, const ObservedStep& seen, int kind,
                           OutcomeRoom& room) const {
    std::vector<double>& out = room.step;
    out = seen.flowed;
    put(kind, step.inputs, room, out.data());
    const Flags settled = step.file.settle(seen.flags, out.data());
    room.ends[kind] = (settled & APPLICABLE) && (settled & TERMINAL);
    bool same = (settled & APPLICABLE) && (room.ends[kind] || !seen.over);
    for (int k = 0; k < columns() && same; ++k) {
        const int column = step.inputs[places_[k]];
        same = out[column] == seen.next_state[column];
    }
    room.fits[kind] = same ? Fit::FITS : Fit::POSSIBLE;
}

/// Writes how each outcome fits an observation; returns how many explain it.
///
/// After the end of an episode, a state need not be what the file says: an end is explained by the
/// outcomes that end the episode, and by those of them that predict the state, if any do.
int OutcomeTable::fit_all(const OutcomeStep& step, const ObservedStep& seen,
                          OutcomeRoom& room) const {
    int exact = 0, ending = 0;
    for (int kind = 0; kind < kinds; ++kind) {
        room.fits[kind] = Fit::IMPOSSIBLE;
        room.ends[kind] = false;
        if (predict(step, kind, schemas[kind], room)) {
            compare(step, seen, kind, room);
            exact += room.fits[kind] == Fit::FITS;
            ending += room.ends[kind];
        }
    }
    if (exact > 0 || !seen.over) return exact;
    for (int kind = 0; kind < kinds; ++kind) {
        if (room.ends[kind]) room.fits[kind] = Fit::FITS;
    }
    return ending;
}

/// Adds outcomes that explain an observation, those of other actions first; returns the number.
int OutcomeTable::find_new(const OutcomeStep& step, const ObservedStep& seen, OutcomeRoom& room) {
    const int before = kinds;
    for (int schema = 0; schema < step.file.others().schemas && kinds < KINDS; ++schema) {
        if (std::find(&schemas[1], &schemas[kinds], schema) != &schemas[kinds] ||
            !predict(step, kinds, schema, room)) {
            continue;
        }
        compare(step, seen, kinds, room);
        if (room.fits[kinds] == Fit::FITS) schemas[kinds++] = schema;
    }
    if (kinds == before && before < KINDS && !seen.over) {
        room.fits[before] = Fit::FITS;
        schemas[kinds] = CHANGE;
        for (int k = 0; k < columns(); ++k) {
            const int column = step.inputs[places_[k]];
            changes[kinds * columns() + k] = seen.next_state[column] - seen.state[column];
        }
        ++kinds;
    }
    return kinds - before;
}

/// Returns the Brier score of the probabilities, of outcomes told apart by what they predict.
double OutcomeTable::score(const OutcomeRoom& room) const {
    const std::vector<double>& probabilities = room.probabilities;
    double score = 1.0, right = 0.0, left = 0.0;
    for (int kind = 0; kind < kinds; ++kind) {
        if (room.fits[kind] != Fit::IMPOSSIBLE) left += probabilities[kind];
    }
    if (left <= 0.0) return 2.0;
    for (int kind = 0; kind < kinds; ++kind) {
        if (room.fits[kind] == Fit::IMPOSSIBLE) continue;
        const double p = probabilities[kind] / left;
        if (room.fits[kind] == Fit::FITS) right += p;
        for (int other = 0; other < kinds; ++other) {
            if (room.fits[other] != Fit::IMPOSSIBLE && alike(room, kind, other)) {
                score += p * probabilities[other] / left;
            }
        }
    }
    return score - 2.0 * right;
}

/// Divides a sample among the outcomes that fit, by their probabilities.
void OutcomeTable::add(int row, OutcomeRoom& room) {
    double total = 0.0;
    int members = 0;
    for (int kind = 0; kind < kinds; ++kind) {
        if (room.fits[kind] != Fit::FITS) continue;
        room.probabilities[kind] += LEAST;
        total += room.probabilities[kind];
        members |= 1 << kind;
    }
    for (int kind = 0; kind < kinds && row > 0; ++kind) {
        if (members >> kind & 1) add_share(row, kind, room.probabilities[kind] / total);
    }
    count_set(members);
    share_sets();
}

/// Counts a part of a sample; to follow an environment that drifts, many counts are halved.
void OutcomeTable::add_share(int row, int kind, double share) {
    double* own = &counts[row * KINDS];
    own[kind] += share;
    totals[row] += share;
    if (totals[row] > MOST) {
        for (int other = 0; other < KINDS; ++other) own[other] *= 0.5;
        totals[row] *= 0.5;
    }
}

/// Counts an observation that a set of outcomes explains, given as bits.
void OutcomeTable::count_set(int of_set) {
    auto place = std::find(members.begin(), members.begin() + sets, of_set) - members.begin();
    if (place == sets) {
        if (sets < SETS) {
            ++sets;
        } else {
            place = std::min_element(numbers.begin(), numbers.end()) - numbers.begin();
        }
        members[place] = of_set;
        numbers[place] = 0.0;
    }
    numbers[place] += 1.0;
}

/// Divides all sets among their outcomes, over all contexts.
///
/// The division is that of the greatest likelihood, by expectation-maximisation (Dempster, Laird &
/// Rubin, Journal of the Royal Statistical Society B 39, 1977).
void OutcomeTable::share_sets() {
    const double half = totals[0] >= MOST ? 0.5 : 1.0;
    totals[0] = 0.0;
    for (int set = 0; set < sets; ++set) {
        numbers[set] *= half;
        totals[0] += numbers[set];
    }
    for (int iteration = 0; iteration < ITERATIONS; ++iteration) {
        std::array<double, KINDS> shares{};
        for (int set = 0; set < sets; ++set) {
            int size = 0;
            double within = 0.0;
            for (int kind = 0; kind < kinds; ++kind) {
                if (members[set] >> kind & 1) {
                    within += counts[kind];
                    ++size;
                }
            }
            for (int kind = 0; kind < kinds; ++kind) {
                if (members[set] >> kind & 1) {
                    const double share = within > 0.0 ? counts[kind] / within : 1.0 / size;
                    shares[kind] += share * numbers[set];
                }
            }
        }
        std::copy_n(shares.begin(), kinds, counts.begin());
    }
}

bool OutcomeTable::count(ObservedStep& seen, const std::vector<int>& inputs, double samples,
                         OutcomeRoom& room) {
    const OutcomeStep step{seen.file, seen.action, inputs, seen.state.data(), seen.flowed.data()};
    step.file.from(step.state);
    const int fitting = fit_all(step, seen, room);
    const int row = find_or_enter(inputs, step.state), before = kinds;
    fill_broadest(room.probabilities.data());
    if (fitting > 0) weigh_experts(row, room);
    refine(row, room.probabilities.data());
    if (fitting > 0 || !seen.over) {
        const double own = score(room);
        // The n-th sample initially has the weight 3 / (2 + n), so that early ones soon lose weight.
        const double rate = std::max(1.0 - PAST, 3.0 / (3.0 + samples));
        scores[0] += rate * ((room.fits[0] == Fit::FITS ? 0.0 : 2.0) - scores[0]);
        scores[1] += rate * (own - scores[1]);
    }
    if (fitting == 0) {
        if (find_new(step, seen, room) == 0) return seen.over;
        std::fill(room.probabilities.begin() + before, room.probabilities.begin() + kinds, 1.0);
    }
    add(row, room);
    return true;
}

void OutcomeTable::start(double samples) {
    sets = 1;
    members[0] = 1;
    numbers[0] = counts[0] = totals[0] = samples;
}

// Contents ----------------------------------------------------------------------------------------

OutcomeTable OutcomeTable::emptied() const {
    OutcomeTable table(places_, context_);
    std::copy_n(schemas.begin(), kinds, table.schemas.begin());
    std::copy_n(changes.begin(), kinds * columns(), table.changes.begin());
    table.kinds = kinds;
    bool nothing = kinds == KINDS;
    for (int kind = 1; kind < kinds; ++kind) {
        const double* change = changes.data() + kind * columns();
        nothing = nothing || (schemas[kind] == CHANGE &&
                              std::count(change, change + columns(), 0.0) == columns());
    }
    if (!nothing) table.schemas[table.kinds++] = CHANGE;
    return table;
}

void OutcomeTable::restore(int new_kinds, int new_sets, int new_rows) {
    require(1 <= new_kinds && new_kinds <= KINDS, "there are no outcomes, or too many");
    require(1 <= new_sets && new_sets <= SETS, "there are no sets, or too many");
    require(1 <= new_rows && new_rows <= ROWS, "there are no codes, or too many");
    for (int set = 0; set < new_sets; ++set) {
        require(1 <= members[set] && members[set] < 1 << new_kinds, "a set has unknown outcomes");
    }
    require(totals[0] > 0.0, "the totals count no sample");
    row_of_code_.clear();
    for (int row = 1; row < new_rows; ++row) {
        const double code = codes[row];
        require(0.0 <= code && code < CODES && code == std::floor(code),
                "codes are not whole numbers");
        require(row_of_code_.emplace(whole(code), row).second, "codes are not distinct");
    }
    kinds = new_kinds, sets = new_sets, rows = new_rows;
}

// For Python ---------------------------------------------------------------------------------------

namespace {

using Positions = In<std::int64_t, nb::ndim<1>>;

std::vector<int> integers(const Positions& numbers) {
    std::vector<int> result;
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        require(std::in_range<int>(numbers.data()[i]), "a number is too large");
        result.push_back(static_cast<int>(numbers.data()[i]));
    }
    return result;
}

bool count(OutcomeTable& table, ObservedStep& step, const Positions& inputs,
           double samples) {
    const int width = step.file.width();
    const std::vector<int> columns = integers(inputs);
    table.check(columns, width, step.file.others().schemas);
    OutcomeRoom room(width);
    return table.count(step, columns, samples, room);
}

}  // namespace

void bind_outcome_counts(nb::module_& module) {
    using Of = OutcomeTable;
    nb::class_<Of> bound(module, "OutcomeTable",
                         "Counts of the outcomes of the ground actions that share the key of a "
                         "feature group.");
    bound
        .def(
            "__init__",
            [](Of* table, const Positions& places, const Positions& context) {
                new (table) Of(integers(places), integers(context));
            },
            nb::arg("places"), nb::arg("context"),
            "Counted fluents, and those of a context: positions within the inputs.")
        .def("count", &count, nb::arg("step"), nb::arg("inputs"), nb::arg("samples"),
             "Update the scores, and then count a sample; there were so many `samples`.\n\n"
             "Returns False where the sample is no outcome, and there is no room for another.")
        .def("start", &Of::start, nb::arg("samples"),
             "Count samples that were as in the file, before all others.")
        .def("emptied", &Of::emptied,
             "Return a table with the same outcomes, 'nothing changes' among them, and no counts.")
        .def("restore", &Of::restore, nb::arg("kinds"), nb::arg("sets"), nb::arg("rows"),
             "Use so many outcomes, sets and rows of the arrays; a ValueError says what does not fit.")
        .def_ro("kinds", &Of::kinds, "Number of outcomes.")
        .def_ro("sets", &Of::sets, "Number of sets of outcomes.")
        .def_ro("rows", &Of::rows, "Number of rows of counts.");
    bind_view(bound, "scores", &Of::scores);
    bind_view(bound, "schemas", &Of::schemas);
    bind_view(bound, "changes", &Of::changes);
    bind_view(bound, "trust", &Of::trust);
    bind_view(bound, "members", &Of::members);
    bind_view(bound, "numbers", &Of::numbers);
    bind_view(bound, "codes", &Of::codes);
    bind_view(bound, "counts", &Of::counts);
    bind_view(bound, "totals", &Of::totals);
    bind_view(bound, "evidence", &Of::evidence);
}

}  // namespace serp
