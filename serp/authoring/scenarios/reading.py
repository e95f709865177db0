"""Reads scenario files: one statement a line, in plain words; errors have their places."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from serp._util.did_you_mean import closest, did_you_mean, listed
from serp.authoring.scenarios import syntax as s
from serp.model.domain import Domain
from serp.model.transition_model import StateError, TransitionModel
from serp.pddl.source import DomainError, Place, Recovery, Source
from serp.pddl.syntax import REWARD, TERMINAL, UNSAFE

EXAMPLES: Final = {
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
_WORD = re.compile(r"[(),=]|[^\s(),=]+")
_OR, _BECAUSE, _IS = (rf"(?<=\s){word}(?=\s|\Z)" for word in ("or", "because", "is"))


def observed_in(source: Source, domain: Domain) -> Domain:
    """Return a domain that observes what stands in the parentheses of a scenario file."""
    inside = re.findall(r"\(([^()\r\n]*)\)", re.sub(r";[^\r\n]*", "", source.text))
    names = (" ".join(name.lower().split()) for name in inside)
    return domain.observed(name for name in names if domain.declared(name) is not None)


def read_scenarios(source: Source, domain: Domain, model: TransitionModel) -> list[s.Scenario]:
    """Read a scenario file; where the source has a `recovery`, all of it that can be understood.

    Raises:
        DomainError: A line is no statement, or names what the domain has not. The errors of later
            lines stand in its notes.
    """
    if source.recovery is None:
        recovery = Recovery()
        whole = Source(source.name, source.text, recovery=recovery)
        found = read_scenarios(whole, domain, model)
        if recovery.errors:
            first, *others = recovery.errors
            for other in others:
                first.add_note(str(other))
            raise first
        return found
    scenarios: dict[str, s.Scenario] = {}
    current: s.Scenario | None = None
    begun = 0  # errors before the current scenario
    for number, start in enumerate(source.line_starts, 1):
        text = source.line_text(number).partition(";")[0].rstrip()
        if not text.strip():
            continue
        line = _Statement(source, start, text, domain, model)
        titled, stray = line.skip("scenario"), current is None
        if titled or current is None:
            _refuse_empty(current, begun)
            begun = source.errors_taken
            current = s.Scenario("", line.place)  # takes the lines below where this one is wrong
        with source.recovering():
            if titled:
                current = line.scenario(scenarios)
            elif stray:
                raise DomainError(
                    f"`{line.next_word.text}` comes before the first scenario",
                    line.place,
                    "begin a scenario with a line such as `scenario the pole leans to the right`",
                )
            else:
                current = line.added_to(current, scenarios)
        if current.title:
            scenarios[current.title.lower()] = current
    _refuse_empty(current, begun)
    return list(scenarios.values())


def _refuse_empty(scenario: s.Scenario | None, begun: int) -> None:
    """Refuse a scenario without expectations, unless something in it could not be read."""
    if scenario is None or scenario.expectations or scenario.place.source.errors_taken > begun:
        return
    with scenario.place.source.recovering():
        raise DomainError(
            f"the scenario `{scenario.title}` has no expectation",
            scenario.place,
            "an expectation is a line such as " + listed([*EXAMPLES.values()][:4]),
        )


class _Statement:
    """One line with a statement, read from left to right; `at` is how far."""

    def __init__(
        self, source: Source, start: int, text: str, domain: Domain, model: TransitionModel
    ) -> None:
        self.at = start + len(text) - len(text.lstrip())
        self.place = source.place(self.at, start + len(text))
        self._domain, self._model = domain, model

    # Statements --------------------------------------------------------------------------------

    def scenario(self, known: dict[str, s.Scenario]) -> s.Scenario:
        """Read the title behind `scenario`."""
        title = self._rest.strip()
        if not title:
            raise DomainError(
                "this scenario has no title", self.place, write="scenario the pole leans right"
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
        first = self.next_word.text.lower()
        if first in ("(", "not", "like"):
            if to.expectations:
                line = to.expectations[0].place.line
                raise DomainError(
                    "this line describes the situation, but follows an expectation",
                    self.place,
                    f"move this line above line {line}, or begin another scenario",
                )
            if first == "like":
                return self._like(to, known)
            return replace(to, given={**to.given, **self._given()})
        expectation = self._expectation()
        if (extra := self.next_word).text:
            problem = f"`{extra.text}` does not belong to this expectation"
            raise DomainError(problem, extra, "begin a new line for another expectation")
        return replace(to, expectations=(*to.expectations, expectation))

    def _given(self) -> dict[str, float]:
        negated = self.skip("not")
        name, numeric, place = self._fluent()
        if name in (REWARD, UNSAFE, TERMINAL):
            raise DomainError(
                f"`({name})` cannot be given: every step resets it", place, "leave this line out"
            )
        if not numeric:
            value = float(not negated)
            if self.next_word.text == "=":
                write = f"not ({name})" if negated else f"({name})"
                raise DomainError(f"`({name})` is true or false", self.place, write=write)
        elif negated:
            raise DomainError(f"`({name})` is a number", self.place, write=f"({name}) = 0")
        else:
            self._expect("=", f"({name}) = 0")
            value = self._number()[0]
        return {name: value}

    def _like(self, to: s.Scenario, known: dict[str, s.Scenario]) -> s.Scenario:
        if to.recorded is not None or to.given:
            raise DomainError(
                "`like` must be the first line", self.place, "write values that differ below it"
            )
        self.skip("like")
        example = "like step 3 of episode 2 of runs/seven"
        if match := self._take(r"step\s+(\d{1,12})(?=\s)"):
            within = self._take(r"of\s+episode\s+(\d{1,12})(?=\s)")
            self._expect("of", example)
            run = self._rest.strip()
            if not run:
                raise self._missing("the folder of a run", example)
            episode = None if within is None else int(within[1])
            return replace(to, recorded=s.StepOfRun(int(match[1]), episode, run, self.place))
        title = self._rest.strip()
        other = known.get(title.lower())
        if other is None or other.title == to.title:
            earlier = [scenario.title for scenario in known.values() if scenario.title != to.title]
            raise DomainError(
                f"there is no scenario `{title}` above",
                self.place,
                did_you_mean(title, earlier) or "write `like step 12 of runs/seven` for a step",
            )
        return replace(to, recorded=other.recorded, given=other.given)

    def _expectation(self) -> s.Expectation:
        for words, example in EXAMPLES.items():
            if not self.skip(words):
                continue
            match words:
                case "chooses" | "does not choose":
                    actions = self._actions("or", _OR)
                    return s.Chooses(actions, words != "chooses", self.place)
                case "refuses":
                    action = self._action(_BECAUSE)
                    reason = self._reason() if self.skip("because") else ""
                    return s.Refuses(action, reason, False, self.place)
                case "allows":
                    return s.Refuses(self._action(), "", True, self.place)
                case "is indifferent":
                    return s.Indifferent(self.place)
                case "after":
                    return self._after(example)
                case _:
                    action, what = self._action(_IS), words.removesuffix(" of")
                    return s.Rates(what, action, self._bounds(example), self.place)
        raise self._unknown_statement()

    def _unknown_statement(self) -> DomainError:
        word, (name, equals, value) = self.next_word, self._rest.partition("=")
        problem = f"no situation or expectation begins with `{word.text}`"
        if name.strip().lower() in [fluent.name for fluent in self._model.fluents]:
            write = f"({name.strip()})" + (f" = {value.strip()}" if equals else "")
            return DomainError(problem, word, f"write a fluent in parentheses: `{write}`")
        advice = did_you_mean(word.text, EXAMPLES) if closest(word.text, EXAMPLES) else ""
        advice = advice or "an expectation begins with " + listed(EXAMPLES)
        return DomainError(problem, word, advice)

    def _reason(self) -> str:
        words, advice = " ".join(self._rest.lower().split()), "reasons are " + listed(s.REASONS)
        if not words:
            raise self._missing("a reason", "", advice)
        if words not in s.REASONS:
            problem = f"`{words}` is not a reason for a refusal"
            raise DomainError(problem, self.next_word, advice)
        self.at = self.place.end
        return words

    def _after(self, example: str) -> s.After:
        fluent = r"\(|(?<=\s)not(?=[\s(])"  # Where the name of an action ends.
        most_steps = 10_000  # Steps that one expectation looks ahead at most.
        steps: int | tuple[int, ...]
        if match := self._take(r"(\d{1,12})(?=\s|\Z)"):
            steps, place = int(match[1]), self.place.source.place(*match.span(1))
            if not self.skip("steps") and not self.skip("step"):
                raise self._missing("`steps`", example)
            if not 1 <= steps <= most_steps:
                raise DomainError(f"{steps:,} steps", place, f"write 1 to {most_steps:,} steps")
            if self.skip("of"):
                steps = (self._action(fluent),) * steps
        else:
            steps = self._actions(",", f",|{fluent}")
        negated = self.skip("not")
        name, numeric, _ = self._fluent()
        if not numeric:
            bounds = s.Bounds(0.0, 0.0, "false") if negated else s.Bounds(1.0, 1.0, "true")
        elif negated:
            advice = "write `is about`, `is at most`"
            raise DomainError(f"`({name})` is a number", self.place, advice)
        else:
            bounds = self._bounds(f"after 3 steps ({name}) is about 1")
        return s.After(steps, name, bounds, self.place)

    # Parts of statements -----------------------------------------------------------------------

    def _actions(self, between: str, end: str) -> tuple[int, ...]:
        """Return the positions of ground actions with a word between them, see `_action`."""
        actions = [self._action(end)]
        while self.skip(between):
            actions.append(self._action(end))
        return tuple(actions)

    def _action(self, end: str = r"\Z") -> int:
        """Return the position of the ground action whose name goes on until an end."""
        match = self._take(rf"(.*?)\s*(?={end}|\Z)")
        known = [action.name for action in self._model.actions]
        if match is None or not match[1]:
            raise self._missing("an action", "", f"actions are {listed(known)}")
        name = " ".join(match[1].lower().split())
        try:
            return self._model.action_index(name)
        except StateError:
            place = self.place.source.place(*match.span(1))
            raise DomainError(
                f"there is no action `{name}`", place, _instead_of(name, known)
            ) from None

    def _fluent(self) -> tuple[str, bool, Place]:
        """Return name, whether it is a number, and place of `(f ...)`."""
        self._expect("(", "(pole-angle)")
        begin = self.at - 1
        match = self._take(r"([^()]*)")
        name = " ".join(match[1].lower().split()) if match is not None else ""
        self._expect(")", f"({name})")
        place = self.place.source.place(begin, self.at)
        if name in (REWARD, UNSAFE, TERMINAL):
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
        if self.skip("about"):
            written = self._number()[1]
            return s.Bounds.about(written, self._number()[0] if self.skip("within") else None)
        for word in ("least", "most"):
            if self.skip(f"at {word}"):
                value, written = self._number()
                ends = (value, math.inf) if word == "least" else (-math.inf, value)
                return s.Bounds(*ends, f"at {word} {written}")
        raise self._missing("`about`, `at least` or `at most`", example)

    def _number(self) -> tuple[float, str]:
        """Return a number, and the number as it is written."""
        number = r"[-−+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d{1,3})?"
        word = self.next_word
        if not word.text:
            raise self._missing("a number", "")
        match = self._take(rf"({number})(?=\s|\Z)")
        if match is None:
            raise DomainError(f"`{word.text}` is not a number", word)
        written = match[1].replace("−", "-")
        if not math.isfinite(float(written)):
            raise DomainError(f"`{word.text}` is too large", word)
        return float(written), written

    # Words -------------------------------------------------------------------------------------

    def _take(self, pattern: str) -> re.Match[str] | None:
        """Read what matches next, blanks aside; None where nothing does."""
        compiled = re.compile(rf"\s*(?:{pattern})", re.IGNORECASE)
        match = compiled.match(self.place.source.text, self.at, self.place.end)
        if match is not None:
            self.at = match.end()
        return match

    def skip(self, words: str) -> bool:
        """Read words, or a sign, if they come next; return whether they do."""
        pattern = r"\s+".join(map(re.escape, words.split()))
        whole = r"(?=[\s(),=]|\Z)" if words[-1].isalpha() else ""
        return self._take(pattern + whole) is not None

    @property
    def next_word(self) -> Place:
        """The place of the next word; an empty one where the line ends."""
        source, end = self.place.source, self.place.end
        match = _WORD.search(source.text, self.at, end)
        return source.place(*match.span()) if match is not None else source.place(end, end)

    @property
    def _rest(self) -> str:
        return self.place.source.text[self.at : self.place.end]

    def _expect(self, words: str, example: str) -> None:
        if not self.skip(words):
            raise self._missing(f"`{words}`", example)

    def _missing(self, what: str, example: str, advice: str = "") -> DomainError:
        word = self.next_word
        problem = f"found `{word.text}`" if word.text else "but the line ends"
        advice = advice or (f"for example `{example}`" if example else "")
        return DomainError(f"expected {what}, {problem}", word, advice)


def _instead_of(name: str, known: Sequence[str]) -> str:
    """Return what to write instead of a name that no ground action has."""
    if objects := [action for action in known if action.startswith(f"{name} ")]:
        return f"write it with its objects: {listed(objects)}"
    if begun := [action for action in known if name.startswith(f"{action} ")]:
        action = max(begun, key=len)
        return (
            f"`{name[len(action) + 1 :]}` cannot follow the action `{action}`; write `because` "
            "before a reason, and `or` before another action"
        )
    return did_you_mean(name, known)
