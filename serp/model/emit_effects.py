"""Writing effects as statements of the generated code: instantaneous ones, and rates."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from serp.model import ground as g
from serp.model.emit import FLAG_NAMES, Emitter, Site, joined
from serp.pddl.syntax import Change

# Changes of one group commute; 0 is the group of a number that has not changed yet.
_KINDS = {"assign": 1, "add": 2, "scale": 3}
_OPERATORS = {Change.INCREASE: "+", Change.DECREASE: "-", Change.SCALE_UP: "*"}


class EffectEmitter(Emitter):
    """Emits effects as statements that change `out`, `reward`, `unsafe` and `terminal`."""

    def effects(
        self, schema: g.GroundSchema, effects: Sequence[g.GroundEffect], source: str
    ) -> None:
        """Emit effects that are all evaluated before any is applied.

        An action reads `s` and writes `out`, so nothing that it reads changes in between. An event
        reads what it writes and keeps conditions and values in temporaries.
        """
        numbers = [e for e in effects if isinstance(e, g.SetNumber)]
        booleans = [e for e in effects if isinstance(e, g.SetBoolean)]
        booleans.sort(key=lambda e: e.value)  # delete before add (PDDL 2.1, definition 9)
        contested = _contested(numbers)
        keep = source == "out" and len(effects) > 1
        ordered: list[g.GroundEffect] = [*booleans, *numbers]
        conditions = self._conditions(schema, ordered, source)
        prepared = []
        for effect in ordered:
            condition = conditions[id(effect.condition)]
            value = self.value(effect.value, source) if isinstance(effect, g.SetNumber) else None
            if keep:
                condition = self.temporary(condition) if condition is not None else None
                value = self.temporary(value) if value is not None else None
            prepared.append((effect, condition, value))
        self.body += [f"kind{target} = 0" for target in sorted(contested)]
        for effect, condition, value in prepared:
            with self.under(condition):
                if isinstance(effect, g.SetBoolean):
                    self._set_boolean(effect)
                else:
                    assert value is not None
                    if effect.target in contested:
                        value = self._refuse_conflict(schema, effect, value)
                    self._set_number(effect, value)
                self.body += self.report(Site("effect", schema, effect))
        for target in sorted({e.target for e in numbers if e.target >= 0}):
            self.require_finite(f"out[{target}]", Site("undefined", schema, None))

    def rates(self, processes: Iterable[g.GroundSchema], source: str, *, rewards: bool) -> None:
        """Emit one explicit Euler step: every rate is evaluated before any is applied.

        With `rewards`, only changes of the reward are emitted.
        """
        prepared = []
        for process in processes:
            effects = [e for e in process.effects if isinstance(e, g.SetNumber)]
            if rewards:
                effects = [e for e in effects if e.target == g.REWARD_TARGET]
            if not effects:
                continue
            test = conjunction(process)
            condition = None
            if test is not None:
                condition = self.temporary(self.truth(test, source, process))
            for effect in effects:
                rate = self.value(effect.value, source)
                change = self.temporary(f"dt * {rate}")
                prepared.append((process, effect, condition, change))
        for process, effect, condition, change in prepared:
            with self.under(condition):
                self._set_number(effect, change)
                self.body += self.report(Site("rate", process, effect))
        first = {effect.target: process for process, effect, _, _ in reversed(prepared)}
        for target in sorted(t for t in first if t >= 0):
            self.require_finite(f"out[{target}]", Site("undefined", first[target], None))

    def _conditions(
        self, schema: g.GroundSchema, effects: Sequence[g.GroundEffect], source: str
    ) -> dict[int, str | None]:
        """Emit the conditions of effects, each once; return them by id, None where always true.

        Where one of them is undefined, the effects on `(unsafe)` whose conditions hold still count.
        """
        uses = Counter(id(effect.condition) for effect in effects)
        found: dict[int, str | None] = {}
        doubts: list[tuple[str, g.Test]] = []
        for effect in effects:
            test, key = effect.condition, id(effect.condition)
            if key in found:
                continue
            if isinstance(test, g.Constant) and test.value:
                found[key] = None
                continue
            certain, doubt = self.decide(test, source)
            if doubt is not None:
                doubts.append((self.temporary(doubt), test))
            found[key] = self.temporary(certain) if uses[key] > 1 else certain
        damaging = [found[id(e.condition)] for e in effects if e.target == g.UNSAFE_TARGET]
        if doubts and damaging:
            with self.under(joined("or", [doubt for doubt, _ in doubts])):
                for condition in damaging:
                    with self.under(condition):
                        self.body.append("unsafe = True")
        for doubt, test in doubts:
            self.refuse(doubt, Site("undefined", schema, test))
        return found

    def _set_boolean(self, effect: g.SetBoolean) -> None:
        if effect.target in FLAG_NAMES:
            self.body.append(f"{FLAG_NAMES[effect.target]} = {effect.value}")
        else:
            self.body.append(f"out[{effect.target}] = {float(effect.value)}")

    def _refuse_conflict(self, schema: g.GroundSchema, effect: g.SetNumber, value: str) -> str:
        """Emit code that ends the step where another effect contradicts this one."""
        kind, group = f"kind{effect.target}", effect.change.group
        clashes = [f"{kind} == {code}" for other, code in _KINDS.items() if other != group]
        if group == "assign":
            value = self.temporary(value)
            clashes.append(f"({kind} == {_KINDS[group]} and out[{effect.target}] != {value})")
        self.refuse(joined("or", clashes), Site("conflict", schema, effect))
        self.body.append(f"{kind} = {_KINDS[group]}")
        return value

    def _set_number(self, effect: g.SetNumber, value: str) -> None:
        target = "reward" if effect.target == g.REWARD_TARGET else f"out[{effect.target}]"
        if effect.change is Change.SCALE_DOWN:
            value = self.quotient(target, value)
        elif effect.change is not Change.ASSIGN:
            value = f"{target} {_OPERATORS[effect.change]} {value}"
        self.body.append(f"{target} = {value}")


def conjunction(schema: g.GroundSchema) -> g.Test | None:
    """Return the whole precondition; None where there is none."""
    tests = schema.preconditions
    if len(tests) < 2:
        return tests[0] if tests else None
    return g.All(tests, schema.place)


def _contested(effects: Sequence[g.SetNumber]) -> set[int]:
    """Return the targets whose effects can contradict each other.

    Increases and decreases commute, and so do scalings. An assignment together with another
    effect, or a mixture of both kinds, has no defined result (PDDL 2.1, definition 8).
    """
    groups: dict[int, list[str]] = {}
    for effect in effects:
        groups.setdefault(effect.target, []).append(effect.change.group)
    return {t for t, of in groups.items() if len(set(of)) > 1 or of.count("assign") > 1}
