"""The settings of the strategies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, get_args

from serp._util.numbers import real, whole
from serp.errors import SettingsError
from serp.pddl.source import did_you_mean

StrategyName = Literal[
    "mixture", "jump-start", "argmax-q", "restrict", "imitate-then-learn", "residual", "dqfd"
]
STRATEGIES: Final[tuple[str, ...]] = get_args(StrategyName)


@dataclass(frozen=True, kw_only=True)
class GuideSettings:
    """How planner and learner share the decisions; the vetoes hold under every strategy.

    Attributes:
        strategy: `mixture` is Algorithm 1, by the learner probability ρ of section `arbiter`. The
            others are what the literature does with a guide; see the modules of
            `serp.strategies`.
        jump_stages: `jump-start`: in so many stages the planner's part of an episode goes to 0.
        jump_tolerance: `jump-start`: how much worse than the best a mean return may be for the
            next stage, as a share of its size.
        restrict_slack: `restrict`: how much worse than the best plan a plan may be, as a share of
            the best plan's worth.
        imitation_steps: `imitate-then-learn`: env steps of imitation at most. `dqfd`: env steps of
            demonstration.
        margin: `imitate-then-learn`, `dqfd`: by how much the planner's action is to be worth more
            than the others, in units of Q.
    """

    strategy: StrategyName = "mixture"
    jump_stages: int = 10
    jump_tolerance: float = 0.1
    restrict_slack: float = 0.2
    imitation_steps: int = 1_000
    margin: float = 0.8

    def __post_init__(self) -> None:
        if self.strategy not in STRATEGIES:
            raise SettingsError(
                f"guide: there is no strategy `{self.strategy}`; "
                f"{did_you_mean(str(self.strategy), STRATEGIES)}"
            )
        for name in ("jump_stages", "imitation_steps"):
            number = whole(getattr(self, name), 1)
            if number is None:
                raise SettingsError(
                    f"guide: {name} must be a whole number >= 1, not {getattr(self, name)!r}"
                )
            object.__setattr__(self, name, number)
        for name in ("jump_tolerance", "restrict_slack", "margin"):
            value = real(getattr(self, name))
            if value is None or value < 0:
                raise SettingsError(f"guide: {name} must be >= 0, not {getattr(self, name)!r}")
            object.__setattr__(self, name, value)
