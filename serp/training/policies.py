"""Which policies of a trained agent there are to be measured and watched."""

from __future__ import annotations

from typing import Literal

Policy = Literal["serp", "planner", "learner", "training"]
"""`serp`: the choice of the trained agent within the vetoes, which is what `serp.Run.decide` does.
`planner`: the planner alone. `learner`: the learner's greedy choice alone, no veto. `training`: who
would act if training went on, planner or learner, within the vetoes. None of them explores."""
