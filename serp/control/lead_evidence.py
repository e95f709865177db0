"""What a run's returns say of planner and learner, as data and in words."""

from __future__ import annotations

from typing import Any, NamedTuple

from serp._util.number_format import measured, percent
from serp._util.text import plural


class Worth(NamedTuple):
    """What the expected return of one lead is believed to be.

    Attributes:
        mean: Mean of the belief.
        deviation: Its standard deviation.
        episodes: Episodes that it led.
    """

    mean: float
    deviation: float
    episodes: int

    def __str__(self) -> str:
        return measured(self.mean, self.deviation)


class LeadEvidence(NamedTuple):
    """The evidence on which the lead of an episode is given to planner or learner.

    Attributes:
        planner, learner: What their episodes are worth; None for one that has not led any. Of
            several planners it is the best one.
        learner_better: Probability that the learner's are worth more.
        planners: Name and worth of each of several planners; empty where there is one.
    """

    planner: Worth | None
    learner: Worth | None
    learner_better: float
    planners: tuple[tuple[str, Worth | None], ...] = ()

    @property
    def leads(self) -> tuple[tuple[str, Worth | None], ...]:
        """Name and worth of each planner, and of the learner."""
        named = tuple((f"planner {name}", worth) for name, worth in self.planners)
        return (*(named or (("planner", self.planner),)), ("learner", self.learner))

    def as_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        return {
            "planner": None if self.planner is None else self.planner._asdict(),
            "learner": None if self.learner is None else self.learner._asdict(),
            "learner_better": self.learner_better,
            "planners": {
                name: None if worth is None else worth._asdict() for name, worth in self.planners
            },
            "sentence": str(self),
        }

    def __str__(self) -> str:
        said = [
            f"the {name} has not led an episode"
            if worth is None
            else f"an episode that the {name} leads is worth {worth} "
            f"({plural(worth.episodes, 'episode')})"
            for name, worth in self.leads
        ]
        better = f"the learner is better with a probability of {percent(self.learner_better)}"
        return "; ".join([*said, better])
