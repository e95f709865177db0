#include "serp/model/learned/outcome_table.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>
#include <utility>

#include "serp/_util/checks.hpp"

namespace serp {

namespace {

using Experts = std::array<double, OutcomeTable::EXPERTS>;

/// Samples that the counts over all contexts are worth, of the experts that count in a context.
constexpr std::array PRIORS{0.1, 1.0, 10.0};
/// Weight of the past in the evidence for an expert, per sample.
constexpr double MEMORY = 0.995;
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
    : places_(std::move(places)), context_(std::move(context)) {
    require(ascending(places_) && ascending(context_), "positions are not in ascending order");
    contents_.schemas = {CHANGE};
    contents_.changes.assign(places_.size(), 0.0);
    contents_.rows.resize(1);
}

void OutcomeTable::check(const std::vector<int>& inputs, int width, int schemas) const {
    const int depth = static_cast<int>(inputs.size());
    require((places_.empty() || places_.back() < depth) &&
                (context_.empty() || context_.back() < depth),
            "counted fluents lie beyond the inputs");
    require(columns() <= width, "more counted fluents than fluents");
    for (const int column : inputs) require(0 <= column && column < width, "inputs of no fluent");
    for (const int schema : contents_.schemas) {
        require(CHANGE <= schema && schema < schemas, "outcomes of unknown action schemas");
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
    const int rows = static_cast<int>(contents_.rows.size());
    if (row != 0 || rows == ROWS) return row;
    contents_.rows.emplace_back().code = code_of(inputs, state);
    row_of_code_.emplace(static_cast<std::int64_t>(contents_.rows.back().code), rows);
    return rows;
}

// Probabilities -----------------------------------------------------------------------------------

/// Computes the probability of each outcome over all contexts; the file's before any sample.
void OutcomeTable::fill_broadest(double* probabilities) const {
    const Row& all = contents_.rows[0];
    for (int kind = 0; kind < kinds(); ++kind) {
        probabilities[kind] = all.total > 0.0 ? all.counts[kind] / all.total : 0.0;
    }
    if (all.total <= 0.0) probabilities[0] = 1.0;
}

/// Turns the probabilities over all contexts into those of a row; row 0 has the same.
void OutcomeTable::refine(int row, double* probabilities) const {
    if (row == 0) return;
    const Row& own = contents_.rows[row];
    const Experts& trust = contents_.trust;
    double weights = trust[EXPERTS - 1] * own.evidence[EXPERTS - 1];
    double counted = 0.0, broader = weights;
    for (std::size_t e = 0; e < PRIORS.size(); ++e) {
        const double weight = trust[e] * own.evidence[e];
        weights += weight;
        counted += weight / (own.total + PRIORS[e]);
        broader += weight * PRIORS[e] / (own.total + PRIORS[e]);
    }
    for (int kind = 0; kind < kinds(); ++kind) {
        const double mixed = counted * own.counts[kind] + broader * probabilities[kind];
        probabilities[kind] = mixed / weights;
    }
}

/// Updates the evidence for the experts of a row by an observation that the outcomes in the room
/// fit; the probabilities in the room are those over all contexts.
void OutcomeTable::weigh_experts(int row, const OutcomeRoom& room) {
    if (row == 0) return;
    Row& own = contents_.rows[row];
    Experts& trust = contents_.trust;
    double fitting = 0.0, possible = 0.0, told = 0.0, known = 0.0;
    for (int kind = 0; kind < kinds(); ++kind) {
        if (room.fits[kind] == Fit::IMPOSSIBLE) continue;
        possible += room.probabilities[kind];
        known += own.counts[kind];
        if (room.fits[kind] == Fit::FITS) {
            fitting += room.probabilities[kind];
            told += own.counts[kind];
        }
    }
    if (possible <= 0.0) return;
    fitting /= possible;
    double most = 0.0, total = 0.0;
    for (std::size_t e = 0; e < EXPERTS; ++e) {
        double predicted = fitting;
        if (e < PRIORS.size()) predicted = (told + PRIORS[e] * fitting) / (known + PRIORS[e]);
        own.evidence[e] = std::pow(own.evidence[e], MEMORY) * std::max(LEAST, predicted);
        most = std::max(most, own.evidence[e]);
    }
    for (std::size_t e = 0; e < EXPERTS; ++e) {
        own.evidence[e] = std::max(LEAST, own.evidence[e] / most);
        total += trust[e] * own.evidence[e];
    }
    for (std::size_t e = 0; e < EXPERTS; ++e) {
        const double believed = trust[e] * own.evidence[e] / total;
        trust[e] = std::max(LEAST, MEMORY * trust[e] + believed);
    }
}

// Predictions -------------------------------------------------------------------------------------

const double* OutcomeTable::values_of(const OutcomeRoom& room, int kind) const {
    return room.values.data() + kind * columns();
}

/// Writes what an outcome of a schema predicts to the room; returns whether it is possible.
bool OutcomeTable::predict(const OutcomeStep& step, int kind, int schema, OutcomeRoom& room) const {
    double* values = room.values.data() + kind * columns();
    if (kind == 0 || schema == CHANGE) {
        const double* changes = contents_.changes.data() + kind * columns();
        for (int k = 0; k < columns(); ++k) {
            const int column = step.inputs[places_[k]];
            values[k] = kind == 0 ? step.flowed[column] : step.state[column] + changes[k];
        }
        return true;
    }
    const int other = step.file.others().of(step.action, schema);
    if (other < 0 || !(step.file.flow(other, room.step.data()) & APPLICABLE)) return false;
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
    for (int kind = 1; kind < kinds(); ++kind) {
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
    for (int kind = 0; kind < kinds(); ++kind) {
        const bool usual = kind == 0 || probabilities[kind] >= RARE;
        if (!usual || !predict(step, kind, contents_.schemas[kind], room)) probabilities[kind] = 0.0;
        left += probabilities[kind];
    }
    if (left <= RARE) probabilities[0] = left = 1.0;
    merge(room);
    int best = 0;
    for (int kind = 0; kind < kinds(); ++kind) {
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
    for (int kind = 0; kind < kinds(); ++kind) {
        room.fits[kind] = Fit::IMPOSSIBLE;
        room.ends[kind] = false;
        if (predict(step, kind, contents_.schemas[kind], room)) {
            compare(step, seen, kind, room);
            exact += room.fits[kind] == Fit::FITS;
            ending += room.ends[kind];
        }
    }
    if (exact > 0 || !seen.over) return exact;
    for (int kind = 0; kind < kinds(); ++kind) {
        if (room.ends[kind]) room.fits[kind] = Fit::FITS;
    }
    return ending;
}

/// Adds outcomes that explain an observation, those of other actions first; returns the number.
int OutcomeTable::find_new(const OutcomeStep& step, const ObservedStep& seen, OutcomeRoom& room) {
    std::vector<int>& schemas = contents_.schemas;
    std::vector<double>& changes = contents_.changes;
    const int before = kinds();
    for (int schema = 0; schema < step.file.others().schemas && kinds() < KINDS; ++schema) {
        const int kind = kinds();
        if (std::find(schemas.begin() + 1, schemas.end(), schema) != schemas.end() ||
            !predict(step, kind, schema, room)) {
            continue;
        }
        compare(step, seen, kind, room);
        if (room.fits[kind] == Fit::FITS) {
            schemas.push_back(schema);
            changes.resize(changes.size() + columns(), 0.0);
        }
    }
    if (kinds() == before && before < KINDS && !seen.over) {
        room.fits[before] = Fit::FITS;
        schemas.push_back(CHANGE);
        for (const int place : places_) {
            const int column = step.inputs[place];
            changes.push_back(seen.next_state[column] - seen.state[column]);
        }
    }
    return kinds() - before;
}

/// Returns the Brier score of the probabilities, of outcomes told apart by what they predict.
double OutcomeTable::score(const OutcomeRoom& room) const {
    const std::vector<double>& probabilities = room.probabilities;
    double score = 1.0, right = 0.0, left = 0.0;
    for (int kind = 0; kind < kinds(); ++kind) {
        if (room.fits[kind] != Fit::IMPOSSIBLE) left += probabilities[kind];
    }
    if (left <= 0.0) return 2.0;
    for (int kind = 0; kind < kinds(); ++kind) {
        if (room.fits[kind] == Fit::IMPOSSIBLE) continue;
        const double p = probabilities[kind] / left;
        if (room.fits[kind] == Fit::FITS) right += p;
        for (int other = 0; other < kinds(); ++other) {
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
    for (int kind = 0; kind < kinds(); ++kind) {
        if (room.fits[kind] != Fit::FITS) continue;
        room.probabilities[kind] += LEAST;
        total += room.probabilities[kind];
        members |= 1 << kind;
    }
    for (int kind = 0; kind < kinds() && row > 0; ++kind) {
        if (members >> kind & 1) add_share(row, kind, room.probabilities[kind] / total);
    }
    count_set(members);
    share_sets();
}

/// Counts a part of a sample; to follow an environment that drifts, many counts are halved.
void OutcomeTable::add_share(int row, int kind, double share) {
    Row& own = contents_.rows[row];
    own.counts[kind] += share;
    own.total += share;
    if (own.total > MOST) {
        for (double& count : own.counts) count *= 0.5;
        own.total *= 0.5;
    }
}

/// Counts an observation that a set of outcomes explains, given as bits.
void OutcomeTable::count_set(int members) {
    std::vector<OutcomeSet>& sets = contents_.sets;
    auto place = std::find_if(sets.begin(), sets.end(),
                              [members](const OutcomeSet& set) { return set.members == members; });
    if (place == sets.end() && sets.size() < SETS) {
        place = sets.insert(place, {members, 0.0});
    } else if (place == sets.end()) {
        place = std::min_element(
            sets.begin(), sets.end(),
            [](const OutcomeSet& one, const OutcomeSet& two) { return one.number < two.number; });
        *place = {members, 0.0};
    }
    place->number += 1.0;
}

/// Divides all sets among their outcomes, over all contexts.
///
/// The division is that of the greatest likelihood, by expectation-maximisation (Dempster, Laird &
/// Rubin, Journal of the Royal Statistical Society B 39, 1977).
void OutcomeTable::share_sets() {
    Row& all = contents_.rows[0];
    const double half = all.total >= MOST ? 0.5 : 1.0;
    all.total = 0.0;
    for (OutcomeSet& set : contents_.sets) {
        set.number *= half;
        all.total += set.number;
    }
    for (int iteration = 0; iteration < ITERATIONS; ++iteration) {
        std::array<double, KINDS> shares{};
        for (const OutcomeSet& set : contents_.sets) {
            int size = 0;
            double within = 0.0;
            for (int kind = 0; kind < kinds(); ++kind) {
                if (set.members >> kind & 1) {
                    within += all.counts[kind];
                    ++size;
                }
            }
            for (int kind = 0; kind < kinds(); ++kind) {
                if (set.members >> kind & 1) {
                    const double share = within > 0.0 ? all.counts[kind] / within : 1.0 / size;
                    shares[kind] += share * set.number;
                }
            }
        }
        std::copy_n(shares.begin(), kinds(), all.counts.begin());
    }
}

bool OutcomeTable::count(ObservedStep& seen, const std::vector<int>& inputs, double* losses,
                         double rate, OutcomeRoom& room) {
    const OutcomeStep step{seen.file, seen.action, inputs, seen.state.data(), seen.flowed.data()};
    step.file.from(step.state);
    const int fitting = fit_all(step, seen, room);
    const int row = find_or_enter(inputs, step.state), before = kinds();
    fill_broadest(room.probabilities.data());
    if (fitting > 0) weigh_experts(row, room);
    refine(row, room.probabilities.data());
    if (fitting > 0 || !seen.over) {
        const double own = score(room);
        losses[0] += rate * ((room.fits[0] == Fit::FITS ? 0.0 : 2.0) - losses[0]);
        losses[1] += rate * (own - losses[1]);
    }
    if (fitting == 0) {
        if (find_new(step, seen, room) == 0) return seen.over;
        std::fill(room.probabilities.begin() + before, room.probabilities.begin() + kinds(), 1.0);
    }
    add(row, room);
    return true;
}

void OutcomeTable::start(double samples) {
    contents_.sets = {{1, samples}};
    contents_.rows[0].counts[0] = contents_.rows[0].total = samples;
}

// Contents ----------------------------------------------------------------------------------------

OutcomeTable OutcomeTable::emptied() const {
    OutcomeTable table(places_, context_);
    table.contents_.schemas = contents_.schemas;
    table.contents_.changes = contents_.changes;
    bool nothing = kinds() == KINDS;
    for (int kind = 1; kind < kinds(); ++kind) {
        const double* changes = contents_.changes.data() + kind * columns();
        nothing = nothing || (contents_.schemas[kind] == CHANGE &&
                              std::count(changes, changes + columns(), 0.0) == columns());
    }
    if (!nothing) {
        table.contents_.schemas.push_back(CHANGE);
        table.contents_.changes.resize(table.contents_.changes.size() + columns(), 0.0);
    }
    return table;
}

void OutcomeTable::restore(Contents contents) {
    const std::size_t kinds = contents.schemas.size(), rows = contents.rows.size();
    require(1 <= kinds && kinds <= KINDS, "there are no outcomes, or too many");
    require(contents.changes.size() == kinds * places_.size(), "changes are not of the outcomes");
    require(*std::min_element(contents.schemas.begin(), contents.schemas.end()) >= CHANGE,
            "outcomes are of unknown schemas");
    require(1 <= contents.sets.size() && contents.sets.size() <= SETS,
            "there are no sets, or too many");
    for (const OutcomeSet& set : contents.sets) {
        require(1 <= set.members && set.members < 1 << kinds, "sets are of unknown outcomes");
    }
    require(1 <= rows && rows <= ROWS, "there are no codes, or too many");
    require(contents.rows[0].total > 0.0, "totals are of no sample");
    std::unordered_map<std::int64_t, int> row_of_code;
    for (std::size_t row = 0; row < rows; ++row) {
        const double code = contents.rows[row].code;
        require(0.0 <= code && code < CODES && code == std::floor(code),
                "codes are not whole numbers");
        const bool entered = row == 0 || row_of_code.emplace(whole(code), row).second;
        require(entered, "codes are not distinct");
    }
    contents_ = std::move(contents);
    row_of_code_ = std::move(row_of_code);
}

}  // namespace serp
