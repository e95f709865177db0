"""Going to and fro without gain: a cycle of two states that brings no reward."""

from __future__ import annotations

from collections import Counter
from typing import Final

import numpy as np

from serp._util.text import percent
from serp.agent.decision import Actor
from serp.runs.recording import ACTORS, Recording
from serp.runs.run import Run
from serp.runs.step_account import error_units, in_units, predicted_states

NEWEST: Final = 2_000
OFTEN: Final = 0.1
"""Steps at the end of a recording that are looked at; share of these to report a cycle from."""
_CLOSE: Final = 0.1
"""Two states are the same if they differ by at most this part of the way between them."""


def oscillation(run: Run, recording: Recording) -> str | None:
    """Return a sentence on going to and fro without gain, with its likely cause; None for none.

    A step belongs to a cycle if it leads back to the state before the last step, as the step before
    did, and no two steps in a row have a positive reward together.
    """
    steps = recording.columns(
        "episode", "state", "next_state", "action", "ground", "executed_by", "indifferent",
        "env_reward", newest=NEWEST,
    )  # fmt: skip
    states, after = steps["state"], steps["next_state"]
    if len(states) < 3:
        return None
    units = error_units(run.model, recording.usual_change, np.zeros(states.shape[1]))
    moved = in_units(after - states, units).max(axis=1, initial=0.0)
    back = in_units(after[1:] - states[:-1], units).max(axis=1, initial=0.0)
    gain = steps["env_reward"][1:] + steps["env_reward"][:-1]
    same = steps["episode"][1:] == steps["episode"][:-1]
    returned = same & (moved[1:] > 0.0) & (back <= _CLOSE * moved[1:]) & (gain <= 0.0)
    cycle = np.flatnonzero(returned[1:] & returned[:-1]) + 2
    if len(cycle) < OFTEN * len(states):
        return None
    names = recording.layout.actions
    common = Counter(names[action] for action in steps["action"][cycle]).most_common(2)
    ground = np.take_along_axis(steps["ground"], steps["action"][:, None], 1)[cycle, 0]
    errors = in_units(
        predicted_states(run.model, states[cycle], ground.astype(np.int64)) - after[cycle], units
    )
    wrong = float((~(errors <= _CLOSE)).any(axis=1).mean())
    planned = steps["executed_by"][cycle] == ACTORS.index(Actor.PLANNER)
    indifferent = float((planned & steps["indifferent"][cycle]).mean())
    if wrong >= 0.5:
        why = "the file predicts these actions wrongly: see the findings of serp diagnose"
    elif indifferent >= 0.5:
        why = "the planner finds no reward: add one on the way, or increase planner.depth"
    elif planned.mean() < 0.5:
        why = "the learner has not learned enough about these states: train longer"
    else:
        why = "each action may overshoot its target: shorten it, or describe its result better"
    which = " and ".join(f"`{name}`" for name, _ in common)
    return (
        f"The robot moves back and forth without progress in {percent(len(cycle) / len(states))} "
        f"of the newest {len(states):,} steps, with {which}. Likely cause: {why}."
    )
