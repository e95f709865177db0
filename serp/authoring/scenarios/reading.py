"""Reads scenario files: one statement a line, in plain words; what is wrong is located."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from serp._util.text import closest, did_you_mean, listed
from serp.authoring.scenarios import syntax as s
from serp.authoring.scenarios.syntax import Line
from serp.model.domain import Domain
from serp.model.transition_model import StateError, TransitionModel
from serp.pddl.source import DomainError, Place, Recovery, Source
from serp.pddl.syntax import REWARD, TERMINAL, UNSAFE

BEGINNINGS: Final = {
    "chooses": "chooses push-left",
    "does not choose": "does not choose push-left",
    "refuses": "refuses push-left because unsafe",
    "allows": "allows push-right",
    "is indifferent": "is indifferent",
    "value of": "value of push-right is about 2.5",
    "reward of": "reward of push-right is at least 0",
    "after": "after 3 steps (pole-angle) is about 0.05",
}
"""How an expectation begins → an example."""


def for_beginning(line: str, word: Place, fluents: Sequence[str]) -> DomainError:
    """Return the error of a line that begins neither a situation nor an expectation.

    Args:
        line: It, as written.
        word: The place of its first word.
        fluents: Names that a situation may give.
    """
    name, equals, value = line.partition("=")
    problem = f"`{word.text}` begins neither a situation nor an expectation"
    if name.strip().lower() in fluents:
        write = f"({name.strip()})" + (f" = {value.strip()}" if equals else "")
        return DomainError(problem, word, f"a fluent stands in parentheses: `{write}`")
    if closest(word.text, BEGINNINGS):
        return DomainError(problem, word, did_you_mean(word.text, BEGINNINGS))
    return DomainError(problem, word, "an expectation begins with " + listed(BEGINNINGS))


def for_action(name: str, known: Sequence[str]) -> str:
    """Return what to write instead of a name that no ground action has."""
    if objects := [action for action in known if action.startswith(f"{name} ")]:
        return f"write it with its objects: {listed(objects)}"
    if begun := [action for action in known if name.startswith(f"{action} ")]:
        action = max(begun, key=len)
        return (
            f"the action is `{action}`; a reason follows `because`, another action follows `or`, "
            f"and `{name[len(action) + 1 :]}` is neither"
        )
    return did_you_mean(name, known)


MOST_STEPS: Final = 10_000
"""Steps that one expectation looks ahead at most."""


def observed_in(source: Source, domain: Domain) -> Domain:
    """Return a domain that observes what stands in the parentheses of a scenario file."""
    inside = re.findall(r"\(([^()\r\n]*)\)", re.sub(r";[^\r\n]*", "", source.text))
    named = (" ".join(name.lower().split()) for name in inside)
    return domain.observed(name for name in named if domain.declared(name) is not None)


def read_scenarios(source: Source, domain: Domain, model: TransitionModel) -> list[s.Scenario]:
    """Read a scenario file; where the source has a `recovery`, all of it that can be understood.

    Args:
        source: The file.
        domain: The domain that it is about.
        model: Its model, which has the actions and fluents.

    Raises:
        DomainError: A line is no statement, or names what the domain has not. What is wrong with
            lines behind the first such one stands in the notes of the error.
    """
    if source.recovery is not None:
        return _read(source, domain, model)
    recovery = Recovery()
    scenarios = _read(Source(source.name, source.text, recovery=recovery), domain, model)
    if recovery.errors:
        first, *others = recovery.errors
        for other in others:
            first.add_note(str(other))
        raise first
    return scenarios


def _read(source: Source, domain: Domain, model: TransitionModel) -> list[s.Scenario]:
    scenarios: dict[str, s.Scenario] = {}
    current: s.Scenario | None = None
    begun = 0  # errors before the current scenario
    for number, start in enumerate(source.line_starts, 1):
        text = source.line_text(number).partition(";")[0].rstrip()
        if not text.strip():
            continue
        line = _Statement(source, start, text, domain, model)
        if line.tokens[0].text == "scenario":
            _refuse_empty(current, begun)
            begun = source.errors_taken
            current = s.Scenario("", line.place)  # takes the lines below where this one is wrong
            with source.recovering():
                current = line.scenario(scenarios)
        elif current is None:
            current = s.Scenario("", line.place)
            with source.recovering():
                raise DomainError(
                    f"`{line.tokens[0].text}` stands before the first scenario",
                    line.place,
                    "a scenario begins with a line such as `scenario the pole leans to the right`",
                )
        else:
            with source.recovering():
                current = line.added_to(current, scenarios)
        if current.title:
            scenarios[current.title.lower()] = current
    _refuse_empty(current, begun)
    return list(scenarios.values())


def _refuse_empty(scenario: s.Scenario | None, begun: int) -> None:
    """Refuse a scenario without expectations, unless something in it could not be read."""
    if scenario is None or scenario.expectations:
        return
    source = scenario.place.source
    if source.errors_taken > begun:
        return
    with source.recovering():
        raise DomainError(
            f"nothing is expected in the scenario `{scenario.title}`",
            scenario.place,
            "an expectation is a line such as " + listed([*BEGINNINGS.values()][:4]),
        )


class _Statement(Line):
    """One line with a statement."""

    def __init__(
        self, source: Source, start: int, text: str, domain: Domain, model: TransitionModel
    ) -> None:
        super().__init__(source, start, text)
        self._domain, self._model = domain, model

    # Statements --------------------------------------------------------------------------------

    def scenario(self, known: dict[str, s.Scenario]) -> s.Scenario:
        """Read `scenario TITLE`."""
        title = self._rest(1)
        if not title:
            raise DomainError(
                "a scenario has a title", self.place, write="scenario the pole leans to the right"
            )
        if (twin := known.get(title.lower())) is not None:
            raise DomainError(
                f"there are two scenarios `{title}`",
                self.place,
                f"the other one is in line {twin.place.line}; give them different titles",
            )
        return s.Scenario(title, self.place)

    def added_to(self, to: s.Scenario, known: dict[str, s.Scenario]) -> s.Scenario:
        """Return a scenario with what the line says."""
        first = self._peek()
        if first in ("(", "not"):
            self._refuse_after_expectations(to)
            return replace(to, given=(*to.given, self._given()))
        if first == "like":
            self._refuse_after_expectations(to)
            return self._like(to, known)
        found = self._expectation()
        if self._at < len(self.tokens):
            extra = self.tokens[self._at]
            raise DomainError(
                f"`{self._text(extra)}` is more than this line can say",
                self.tokens[self._at].place,
                "begin a new line for another expectation",
            )
        return replace(to, expectations=(*to.expectations, found))

    def _refuse_after_expectations(self, to: s.Scenario) -> None:
        if to.expectations:
            raise DomainError(
                "the situation comes before what is expected in it",
                self.place,
                f"move this line above line {to.expectations[0].place.line}, or begin another "
                "scenario",
            )

    def _given(self) -> s.GivenValue:
        negated = self._skip("not")
        name, numeric, place = self._fluent(given=True)
        if not numeric:
            if self._peek() == "=":
                raise DomainError(
                    f"`({name})` is true or false",
                    self.place,
                    write=f"({name})" if not negated else f"not ({name})",
                )
            return s.GivenValue(name, float(not negated), place)
        if negated:
            raise DomainError(f"`({name})` is a number", self.place, write=f"({name}) = 0")
        self._expect("=", f"({name}) = 0")
        return s.GivenValue(name, self._number()[0], place)

    def _like(self, to: s.Scenario, known: dict[str, s.Scenario]) -> s.Scenario:
        if to.recorded is not None or to.given:
            raise DomainError(
                "`like` comes first", self.place, "values that differ follow below it"
            )
        self._at = 1
        if self._peek() == "step" and len(self.tokens) > 2 and self.tokens[2].text.isdigit():
            self._at, step, episode = 3, int(self.tokens[2].text), None
            self._expect("of", "like step 12 of runs/seven")
            if self._skip("episode"):
                episode = self._whole("like step 3 of episode 2 of runs/seven")
                self._expect("of", "like step 3 of episode 2 of runs/seven")
            run = self._rest(self._at)
            if not run:
                raise self._missing("the folder of a run", "like step 12 of runs/seven")
            return replace(to, recorded=s.StepOfRun(step, episode, run, self.place))
        title = self._rest(1)
        other = known.get(title.lower())
        if other is None or other.title == to.title:
            earlier = [known[key].title for key in known if known[key].title != to.title]
            raise DomainError(
                f"there is no scenario `{title}` above",
                self.place,
                did_you_mean(title, earlier) or "write `like step 12 of runs/seven` for a step",
            )
        return replace(to, recorded=other.recorded, given=other.given)

    def _expectation(self) -> s.Expectation:
        for words, read in (
            ("chooses", self._chooses),
            ("does not choose", self._chooses),
            ("refuses", self._refuses),
            ("allows", self._allows),
            ("is indifferent", lambda: s.Indifferent(self.place)),
            ("value of", self._rates),
            ("reward of", self._rates),
            ("after", self._after),
        ):
            if self._begins(words.split()):
                found: s.Expectation = read()
                return found
        fluents = [fluent.name for fluent in self._model.fluents]
        raise for_beginning(self._rest(0), self.tokens[0].place, fluents)

    def _chooses(self) -> s.Expectation:
        actions = [self._action({"or"})]
        while self._skip("or"):
            actions.append(self._action({"or"}))
        return s.Chooses(tuple(actions), self.tokens[0].text == "does", self.place)

    def _refuses(self) -> s.Expectation:
        action = self._action({"because"})
        if not self._skip("because"):
            return s.Refuses(action, "", self.place)
        words = " ".join(token.text for token in self.tokens[self._at :])
        if words not in s.REASONS:
            place = self.tokens[self._at].place if words else self._end
            raise DomainError(
                f"`{words}` is no reason to refuse an action" if words else "the reason is missing",
                place,
                "reasons are " + listed(s.REASONS),
            )
        self._at = len(self.tokens)
        return s.Refuses(action, words, self.place)

    def _allows(self) -> s.Expectation:
        return s.Allows(self._action(set()), self.place)

    def _rates(self) -> s.Expectation:
        what = self.tokens[0].text
        action = self._action({"is"})
        return s.Rates(what, action, self._bounds(f"{what} of push-right is about 2"), self.place)

    def _after(self) -> s.Expectation:
        steps = self._steps()
        negated = self._skip("not")
        name, numeric, _ = self._fluent(given=False)
        if numeric and not negated:
            bounds = self._bounds(f"after 3 steps ({name}) is about 1")
        elif numeric:
            raise DomainError(
                f"`({name})` is a number", self.place, "write `is about`, `is at most`"
            )
        else:
            bounds = s.Bounds(0.0, 0.0, "false") if negated else s.Bounds(1.0, 1.0, "true")
        return s.After(steps, name, bounds, self.place)

    def _steps(self) -> int | tuple[int, ...]:
        first = self._peek()
        if first.isdigit():
            count = self._whole("after 3 steps (f) is about 1")
            if not self._skip("steps") and not self._skip("step"):
                raise self._missing("`steps`", "after 3 steps (f) is about 1")
            if not 1 <= count <= MOST_STEPS:
                raise DomainError(
                    f"{count:,} steps", self.tokens[1].place, f"write 1 to {MOST_STEPS:,} steps"
                )
            if not self._skip("of"):
                return count
            return (self._action({"(", "not"}),) * count
        actions = [self._action({",", "(", "not"})]
        while self._skip(","):
            actions.append(self._action({",", "(", "not"}))
        return tuple(actions)

    # Parts of statements -----------------------------------------------------------------------

    def _action(self, ends: set[str]) -> int:
        """Return the position of a ground action, whose name ends before one of some words."""
        begin = self._at
        while self._at < len(self.tokens) and self.tokens[self._at].text not in ends:
            self._at += 1
        words = self.tokens[begin : self._at]
        known = [action.name for action in self._model.actions]
        if not words:
            raise self._missing("an action", "", f"actions are {listed(known)}")
        name = " ".join(token.text for token in words)
        try:
            return self._model.action_index(name)
        except StateError:
            place = self.place.source.place(words[0].place.start, words[-1].place.end)
            raise DomainError(
                f"there is no action `{name}`", place, for_action(name, known)
            ) from None

    def _fluent(self, *, given: bool) -> tuple[str, bool, Place]:
        """Return name, whether it is a number, and place of `(f ...)`."""
        begin = self._at
        self._expect("(", "(pole-angle)")
        while self._at < len(self.tokens) and self.tokens[self._at].text not in "()":
            self._at += 1
        name = " ".join(token.text for token in self.tokens[begin + 1 : self._at])
        self._expect(")", f"({name})")
        start = self.tokens[begin].place.start
        place = self.place.source.place(start, self.tokens[self._at - 1].place.end)
        if name in (REWARD, UNSAFE, TERMINAL):
            if given:
                raise DomainError(
                    f"`({name})` starts afresh in every step", place, "leave this line out"
                )
            return name, name == REWARD, place
        declared = self._domain.declared(name)
        known = [fluent.name for fluent in self._model.fluents]
        if declared is None or (name not in known and name not in self._model.ground.static):
            raise DomainError(f"there is no `({name})`", place, did_you_mean(name, known))
        if name not in known:
            raise DomainError(f"`({name})` is fixed by the problem file", place, "change it there")
        return name, declared.numeric, place

    def _bounds(self, example: str) -> s.Bounds:
        self._expect("is", example)
        if self._skip("about"):
            _, written = self._number()
            within = None
            if self._skip("within"):
                within = self._number()[0]
            return s.Bounds.about(written, within)
        if self._skip("at"):
            for word in ("least", "most"):
                if self._skip(word):
                    value, written = self._number()
                    ends = (value, math.inf) if word == "least" else (-math.inf, value)
                    return s.Bounds(*ends, f"at {word} {written}")
        raise self._missing("`about`, `at least` or `at most`", example)
