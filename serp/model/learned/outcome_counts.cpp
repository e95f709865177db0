// The outcome counts as Python sees them.
#include <cstdlib>

#include "serp/_util/arrays.hpp"
#include "serp/_util/checks.hpp"
#include "serp/model/learned/adapted_model.hpp"
#include "serp/model/learned/block_view.hpp"
#include "serp/model/learned/outcome_table.hpp"

namespace serp {

namespace {

using Positions = In<std::int64_t, nb::ndim<1>>;

std::vector<int> integers(const Positions& numbers) {
    std::vector<int> result;
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        require(std::abs(numbers.data()[i]) <= 1 << 30, "there are numbers that are too large");
        result.push_back(static_cast<int>(numbers.data()[i]));
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
        .def("count", &count, nb::arg("step"), nb::arg("inputs"), nb::arg("losses").noconvert(),
             nb::arg("rate"),
             "Update the losses `[2]` of the file and of the counts, and then count a sample.\n\n"
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
