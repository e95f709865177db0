"""The protocol of a comparison: budget and evaluations, the same for all of its trials."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from serp._util.numbers import whole
from serp.errors import SettingsError


@dataclass(frozen=True, kw_only=True)
class ComparisonProtocol:
    """Budget and evaluations, the same for all trials of a comparison.

    Attributes:
        env_steps: Budget of a training.
        evaluate_every: Env steps between evaluations of the learner; the last is at the end.
        evaluation_episodes: Episodes of such an evaluation.
        final_episodes: Episodes of each evaluation at the end.
        evaluation_seed: Seed of the environment in evaluations; every evaluation plays the same
            episodes.

    Raises:
        SettingsError: One of them is not a whole number in its range.
    """

    env_steps: int
    evaluate_every: int
    evaluation_episodes: int = 10
    final_episodes: int = 50
    evaluation_seed: int = 99

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            least = 0 if name == "evaluation_seed" else 1
            number = whole(value, least)
            if number is None:
                raise SettingsError(f"{name} must be a whole number >= {least}, not {value!r}")
            object.__setattr__(self, name, number)

    def due(self, env_steps: int) -> bool:
        """Return whether the learner is evaluated after so many env steps."""
        return env_steps % self.evaluate_every == 0 or env_steps == self.env_steps
