"""What a run learned of the model: feature groups, and what they share."""

from __future__ import annotations

from typing import Any, NamedTuple

from .outcomes import CountTable
from .reading import Arrays, Entry
from .residual import FILE, LINEAR, FittedRegression


class LearnedGroup(NamedTuple):
    """Fluents whose change is learned together: columns of the state, and the models of it.

    Attributes:
        inputs, targets: Columns of the state.
        regression, head: Its residual, and the place of the action in it; None for none.
        table: Its counted outcomes; None for none.
        columns: Columns of the counted fluents.
    """

    inputs: list[int]
    targets: list[int]
    regression: FittedRegression | None
    head: int
    table: CountTable | None
    columns: list[int]


class Adaptation:
    """What was learned.

    Args:
        data: The entry `adaptation` of the policy.
        arrays: Its arrays.
        width: Length of a state.
        actions: Number of ground actions.

    Attributes:
        theta: Revised parameters.
        revised: Whether they differ from those of the file.
        flagging: Whether events can flag a step unsafe.
        groups: `[A]` feature groups of each action.
        others: `[A, S]` the action of each schema with the same arguments; -1 for none.
    """

    def __init__(self, data: Entry, arrays: Arrays, width: int, actions: int) -> None:
        written = len(arrays.numbers("written", None))
        self.theta: list[float] = arrays.numbers("theta", written).tolist()
        self.revised, self.flagging = data["revised"].truth(), data["flagging"].truth()
        stochastic = data["stochastic"].truth()
        others = arrays.whole("others", -1, actions - 1, actions, None)
        self.others: list[list[int]] = others.tolist()
        regressions = [
            FittedRegression(each, arrays.under(f"regression{k}."))
            for k, each in enumerate(data["regressions"].items())
        ]
        tables = [
            CountTable(each, arrays.under(f"table{k}."), others.shape[1])
            for k, each in enumerate(data["tables"].items())
        ]

        def group(entry: Entry) -> LearnedGroup:
            regression: FittedRegression | None = None
            table: CountTable | None = None
            inputs, targets = entry["inputs"].positions(width), entry["targets"].positions(width)
            head = entry["head"].whole(0)
            if not entry["regression"].none:
                regression = regressions[entry["regression"].whole(0, len(regressions) - 1)]
                entry["inputs"].items(regression.depth), entry["targets"].items(regression.count)
                head = entry["head"].whole(0, regression.heads - 1)
                regression = None if regression.most == FILE else regression
            if not entry["table"].none:
                table = tables[entry["table"].whole(0, len(tables) - 1)]
                entry["inputs"].items(table.inputs)
                table = table if stochastic else None
            columns = [] if table is None else [inputs[place] for place in table.places]
            return LearnedGroup(inputs, targets, regression, head, table, columns)

        of_actions = data["actions"].items(actions)
        self.groups = [[group(each) for each in entry.items()] for entry in of_actions]
        self.counted = [any(each.table is not None for each in groups) for groups in self.groups]
        self.written_out = [_written_out(groups) for groups in self.groups]
        """`[A]` statements that add the residual of an action, where that is linear."""
        self.residual = [
            [each for each in groups if each.regression is not None] if written is None else []
            for groups, written in zip(self.groups, self.written_out, strict=True)
        ]
        """`[A]` groups with a residual that is not written out."""

    def changes(self, action: int) -> bool:
        """Return whether the prediction of an action differs from that of the file."""
        learned = self.written_out[action] or self.residual[action] or self.counted[action]
        return self.revised or bool(learned)


def _written_out(groups: list[LearnedGroup]) -> list[Any] | None:
    """Return the residual of an action as statements of `program`; None where it is not linear.

    Where a result is not finite, that of the file is kept.
    """
    used = [(group, group.regression) for group in groups if group.regression is not None]
    if any(regression.most != LINEAR or regression.bits for _, regression in used):
        return None
    before: dict[int, list[Any]] = {}
    changes: list[Any] = []
    count = 0
    for group, regression in used:
        normalised = []
        for k, column in enumerate(group.inputs):
            centre, shrink = float(regression.centre[k]), float(regression.shrink[k])
            variable: list[Any] = ["var", f"t{count}"]
            count += 1
            x: list[Any] = ["*", ["-", ["at", "s", column], centre], shrink]
            changes.append(["set", variable, x])
            normalised.append(variable)
        for t, total, weights in regression.linear_of(group.head, LINEAR):
            value: Any = total
            for weight, x in zip(weights, normalised, strict=True):
                value = ["+", value, ["*", weight, x]]
            place = ["at", "out", group.targets[t]]
            before.setdefault(group.targets[t], place)
            changes.append(["set", place, ["+", place, value]])
    if not before:
        return []
    kept = [(place, ["var", f"t{count + k}"]) for k, place in enumerate(before.values())]
    wrong: Any = 0.0
    for place, _ in kept:
        wrong = ["+", wrong, ["-", place, place]]
    return [
        *(["set", variable, place] for place, variable in kept),
        *changes,
        ["when", ["!=", wrong, 0.0], [["set", place, variable] for place, variable in kept]],
        ["return", ["var", "flags"]],
    ]
