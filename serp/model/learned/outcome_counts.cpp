// The outcome counts as Python sees them.
#include <algorithm>
#include <cmath>

#include "serp/_util/arrays.hpp"
#include "serp/_util/checks.hpp"
#include "serp/model/learned/adapted_model.hpp"
#include "serp/model/learned/outcome_table.hpp"

namespace serp {

namespace {

using Vector = In<double, nb::ndim<1>>;
using Matrix = In<double, nb::ndim<2>>;
using Positions = In<std::int64_t, nb::ndim<1>>;

int integer(double number) {
    constexpr int most = 1 << 30;
    require(std::abs(number) <= most && number == std::floor(number),
            "there are numbers that are not whole, or too large");
    return static_cast<int>(number);
}

template <class Number>
std::vector<int> integers(const In<Number, nb::ndim<1>>& numbers) {
    std::vector<int> result;
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        result.push_back(integer(static_cast<double>(numbers.data()[i])));
    }
    return result;
}

bool count(OutcomeTable& table, ObservedStep& step, const Positions& inputs,
           const Out<double, nb::shape<2>>& losses, double rate) {
    const int width = step.file.width();
    const std::vector<int> columns = integers(inputs);
    table.check(columns, width, step.file.others().schemas);
    OutcomeRoom room(width);
    return table.count(step, columns, losses.data(), rate, room);
}

nb::dict contents(const OutcomeTable& table) {
    const OutcomeTable::Contents& contents = table.contents();
    std::vector<double> sets, codes, counts, totals, evidence;
    for (const OutcomeTable::OutcomeSet& set : contents.sets) {
        sets.insert(sets.end(), {static_cast<double>(set.members), set.number});
    }
    for (const OutcomeTable::Row& row : contents.rows) {
        codes.push_back(row.code);
        counts.insert(counts.end(), row.counts.begin(), row.counts.end());
        totals.push_back(row.total);
        evidence.insert(evidence.end(), row.evidence.begin(), row.evidence.end());
    }
    const std::size_t kinds = contents.schemas.size(), rows = contents.rows.size();
    const auto columns = static_cast<std::size_t>(table.columns());
    const auto copy = [](const auto& numbers) {
        return std::vector<double>(numbers.begin(), numbers.end());
    };
    nb::dict arrays;
    arrays["schemas"] = array_of(copy(contents.schemas), {kinds});
    arrays["changes"] = array_of(copy(contents.changes), {kinds, columns});
    arrays["trust"] = array_of(copy(contents.trust), {contents.trust.size()});
    arrays["sets"] = array_of(std::move(sets), {contents.sets.size(), 2});
    arrays["codes"] = array_of(std::move(codes), {rows});
    arrays["counts"] = array_of(std::move(counts), {rows, KINDS});
    arrays["totals"] = array_of(std::move(totals), {rows});
    arrays["evidence"] = array_of(std::move(evidence), {rows, OutcomeTable::EXPERTS});
    return arrays;
}

void restore(OutcomeTable& table, const Vector& schemas, const Matrix& changes, const Vector& trust,
             const Matrix& sets, const Vector& codes, const Matrix& counts, const Vector& totals,
             const Matrix& evidence) {
    constexpr std::size_t experts = OutcomeTable::EXPERTS;
    const std::size_t rows = codes.size();
    require(changes.shape(1) == static_cast<std::size_t>(table.columns()) &&
                trust.size() == experts && sets.shape(1) == 2 && counts.shape(0) == rows &&
                counts.shape(1) == KINDS && totals.size() == rows && evidence.shape(0) == rows &&
                evidence.shape(1) == experts,
            "the arrays have other shapes than expected");
    OutcomeTable::Contents contents;
    contents.schemas = integers(schemas);
    contents.changes = vector_of(changes);
    std::copy_n(trust.data(), experts, contents.trust.begin());
    for (std::size_t k = 0; k < sets.shape(0); ++k) {
        contents.sets.push_back({integer(sets.data()[2 * k]), sets.data()[2 * k + 1]});
    }
    contents.rows.resize(rows);
    for (std::size_t k = 0; k < rows; ++k) {
        OutcomeTable::Row& row = contents.rows[k];
        row.code = codes.data()[k];
        std::copy_n(counts.data() + k * KINDS, KINDS, row.counts.begin());
        row.total = totals.data()[k];
        std::copy_n(evidence.data() + k * experts, experts, row.evidence.begin());
    }
    table.restore(std::move(contents));
}

}  // namespace

void bind_outcome_counts(nb::module_& module) {
    nb::class_<OutcomeTable>(module, "OutcomeTable",
                             "Counts of the outcomes of the ground actions that share the key of a "
                             "feature group.")
        .def(
            "__init__",
            [](OutcomeTable* table, const Positions& places, const Positions& context) {
                new (table) OutcomeTable(integers(places), integers(context));
            },
            nb::arg("places"), nb::arg("context"),
            "Counted fluents, and those of a context: positions within the inputs.")
        .def("count", &count, nb::arg("step"), nb::arg("inputs"), nb::arg("losses").noconvert(),
             nb::arg("rate"),
             "Update the losses `[2]` of the file and of the counts, and then count a sample.\n\n"
             "Returns False where the sample is no outcome, and there is no room for another.")
        .def("start", &OutcomeTable::start, nb::arg("samples"),
             "Count samples that were as in the file, before all others.")
        .def("emptied", &OutcomeTable::emptied,
             "Return a table with the same outcomes, 'nothing changes' among them, and no counts.")
        .def("contents", &contents,
             nb::sig("def contents(self) -> dict[str, numpy.typing.NDArray[numpy.float64]]"),
             "Return the arrays that `restore` takes: K outcomes, R rows of counts (the first over "
             "all contexts).")
        .def("restore", &restore, nb::arg("schemas"), nb::arg("changes"), nb::arg("trust"),
             nb::arg("sets"), nb::arg("codes"), nb::arg("counts"), nb::arg("totals"),
             nb::arg("evidence"),
             "Replace the contents; a ValueError says what does not fit.");
}

}  // namespace serp
