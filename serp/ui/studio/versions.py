"""Two versions of a domain, compared on the same states: where they decide differently."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from serp._util.text import readable
from serp.errors import SerpError
from serp.planning.forecast import SAFE, Forecast
from serp.planning.lookahead import Lookahead
from serp.ui.studio.reading import Surroundings, Version, read
from serp.ui.studio.shown_state import ShownState


@dataclass(frozen=True)
class Difference:
    """A state in which two versions decide differently.

    Attributes:
        state: Its position among the states.
        first, second: What each chooses; empty for none.
        values: What each thinks its choice is worth.
        harms: Actions that only one of them takes for harmful, as `+name` (the second does) and
            `-name`.
    """

    state: int
    first: str
    second: str
    values: tuple[str, str]
    harms: tuple[str, ...]


@dataclass(frozen=True)
class VersionsCompared:
    """What came of a comparison.

    Attributes:
        states: Number of states.
        differences: Those in which the versions differ in their choice or in what is harmful.
        chosen: Number of those in which they differ in their choice.
    """

    states: int
    differences: tuple[Difference, ...]

    @property
    def chosen(self) -> int:
        """Number of states in which they differ in their choice."""
        return sum(each.first != each.second for each in self.differences)


def compare_versions(
    first: Version, second: Version, surroundings: Surroundings, states: Sequence[ShownState]
) -> VersionsCompared:
    """Let two versions decide in the same states, by fluents of the same names.

    Raises:
        SerpError: A version is wrong.
    """
    deciders = [_Decider(version, surroundings) for version in (first, second)]
    found = []
    for number, state in enumerate(states):
        (name, value, harms), (other, worth, harmful) = (each.decide(state) for each in deciders)
        common = set(deciders[0].names) & set(deciders[1].names)
        changed = [f"+{each}" for each in sorted((harmful - harms) & common)]
        changed += [f"-{each}" for each in sorted((harms - harmful) & common)]
        if name != other or changed:
            found.append(Difference(number, name, other, (value, worth), tuple(changed)))
    return VersionsCompared(len(states), tuple(found))


class _Decider:
    """The lookahead of a version."""

    def __init__(self, version: Version, surroundings: Surroundings) -> None:
        planner = read(version, surroundings).planner
        if planner is None:
            raise SerpError(f"{version.domain_name}: a version with errors decides nothing")
        self._model = planner.model
        self._lookahead = Lookahead(planner.model, planner.settings)
        self.names = [action.name for action in planner.model.actions]

    def decide(self, shown: ShownState) -> tuple[str, str, set[str]]:
        """Return the choice, what it is worth, and the actions that are harmful."""
        forecast = self._lookahead.forecast(shown.state(self._model))
        harms = {name for k, name in enumerate(self.names) if _harmful(forecast, k)}
        if forecast.choice < 0:
            return "", "", harms
        return (
            self.names[forecast.choice],
            readable(float(forecast.value[forecast.choice])),
            harms,
        )


def _harmful(forecast: Forecast, k: int) -> bool:
    return bool(forecast.applicable[k]) and forecast.safe_steps[k] != SAFE
