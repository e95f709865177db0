"""Names, meanings and units of the measures of a trial, and which way is better."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final, Literal, NamedTuple


class Measure(NamedTuple):
    """One measure.

    Attributes:
        name: Its column in `measures.csv`.
        title: In tables, short.
        meaning: Its definition, in a sentence or two.
        unit: `return`, `env steps`, `episodes`, `steps`, `seconds`, `share` or `count`.
        better: Which way is better; None where neither is.
        table: The table of the report that has it: `returns`, `lead`, `times`, `safety` or `cost`.
        compared: Whether the report has the differences between algorithms.
    """

    name: str
    title: str
    meaning: str
    unit: str
    better: Literal["higher", "lower"] | None
    table: Literal["returns", "lead", "times", "safety", "cost"]
    compared: bool = False

    @property
    def time(self) -> bool:
        """Whether it is a time until something, infinite where that never happened."""
        return self.table == "times" and self.unit != "share"


# fmt: off
MEASURES: Final = (
    Measure("training_area", "area under the training curve",
            "Time average, over the budget, of the return of the running training episode; the "
            "last complete episode's return goes on to the end of the budget.",
            "return", "higher", "returns", True),
    Measure("learner_area", "area under the learner's curve",
            "Time average, over the budget, of the mean returns of the learner alone (greedy, no "
            "planner, no veto), linear between evaluations and constant before and after them.",
            "return", "higher", "returns", True),
    Measure("first_10", "first 10 episodes",
            "Mean return of the first 10 training episodes (of all, where there are fewer).",
            "return", "higher", "returns", True),
    Measure("first_50", "first 50 episodes",
            "Mean return of the first 50 training episodes (of all, where there are fewer).",
            "return", "higher", "returns", True),
    Measure("last_20", "last 20 episodes",
            "Mean return of the last 20 training episodes (of all, where there are fewer).",
            "return", "higher", "returns", True),
    Measure("threshold_env_steps", "env steps to the threshold",
            "Env steps until the mean return of 20 training episodes in a row first reaches the "
            "threshold. Fewer than 20 training episodes are too few to say so, or to say never.",
            "env steps", "lower", "times", True),
    Measure("threshold_episodes", "episodes to the threshold",
            "Training episodes until the same.",
            "episodes", "lower", "times"),
    Measure("learner_threshold_env_steps", "env steps to the learner's threshold",
            "Env steps until an evaluation of the learner alone first reaches the threshold in "
            "the mean. Fewer than 20 evaluation episodes in all are too few to say so, or never.",
            "env steps", "lower", "times"),
    Measure("learner_threshold_held", "threshold held",
            "Share of the evaluations after that one that reach the threshold, too.",
            "share", "higher", "times"),
    Measure("final_learner", "final learner alone",
            "Mean return of the learner alone (greedy, no planner, no veto) after training.",
            "return", "higher", "returns", True),
    Measure("final_vetoed", "final policy within the vetoes",
            "Mean return of the trained policy after training: the choice of the strategy, of the "
            "learner where there is none; the planner's action replaces a refused proposal.",
            "return", "higher", "returns"),
    Measure("planner", "planner alone",
            "Mean return of the planner alone, evaluated at the end of training.",
            "return", "higher", "returns"),
    Measure("rho", "ρ",
            "Probability after training that the learner leads an episode (`evidence`: that its "
            "lead is worth more, by the returns) or makes a proposal (`mixture`).",
            "share", None, "lead"),
    Measure("planner_led", "an episode that the planner leads",
            "What it is worth by the evidence of the training.",
            "return", "higher", "lead"),
    Measure("learner_led", "an episode that the learner leads",
            "What it is worth by the evidence of the training.",
            "return", "higher", "lead"),
    Measure("episodes", "episodes",
            "Complete training episodes.",
            "episodes", None, "cost"),
    Measure("terminated", "terminated episodes",
            "Training episodes that the environment ended (a fall, a goal; not a time limit).",
            "episodes", None, "safety"),
    Measure("unsafe", "unsafe executed",
            "Actions executed in training that the domain file flags unsafe.",
            "steps", "lower", "safety", True),
    Measure("avoidable_unsafe", "avoidable unsafe executed",
            "Those of them that were executed while another action was not flagged.",
            "steps", "lower", "safety"),
    Measure("unsafe_observed", "came out unsafe",
            "Steps of training that came out unsafe, by what was observed, foreseen or not.",
            "steps", "lower", "safety"),
    Measure("final_learner_unsafe", "unsafe, final learner alone",
            "Unsafe actions of the final evaluation of the learner alone, an episode.",
            "steps", "lower", "safety"),
    Measure("final_vetoed_unsafe", "unsafe, final policy within the vetoes",
            "Unsafe actions of the final evaluation within the vetoes, an episode.",
            "steps", "lower", "safety"),
    Measure("final_learner_unsafe_observed", "came out unsafe, final learner alone",
            "Steps of the final evaluation of the learner alone that came out unsafe, an episode.",
            "steps", "lower", "safety"),
    Measure("final_vetoed_unsafe_observed", "came out unsafe, final policy within the vetoes",
            "Steps of the final evaluation within the vetoes that came out unsafe, an episode.",
            "steps", "lower", "safety"),
    Measure("vetoes", "vetoes",
            "Proposals refused in training.",
            "steps", None, "safety"),
    Measure("planner_share", "planner's share",
            "Share of the env steps in which the planner's action was executed.",
            "share", None, "cost"),
    Measure("seconds", "seconds of training",
            "Wall time of training, evaluations left out.",
            "seconds", "lower", "cost"),
    Measure("seconds_per_1000", "seconds per 1,000 env steps",
            "The same per 1,000 env steps.",
            "seconds", "lower", "cost"),
)
"""All measures that every trial has, in the order in which they are reported."""
# fmt: on

BY_NAME: Final[Mapping[str, Measure]] = {measure.name: measure for measure in MEASURES}


def extra_measures(names: Iterable[str]) -> tuple[Measure, ...]:
    """Return the measures that only some tasks have: outcomes and counters of the environment."""
    found = []
    for name in sorted({name for name in names if name not in BY_NAME}):
        kind, _, what = name.partition(".")
        if kind == "outcome":
            title, unit = f"outcome {what}", "episodes"
            meaning = f"Training episodes that ended with the outcome “{what}”."
        else:
            title, unit = what, "count"
            meaning = f"Sum of the environment's “{what}” at the ends of the training episodes."
        found.append(Measure(name, title, meaning, unit, None, "safety"))
    return tuple(found)
