"""Training, evaluation, comparison, tuning, records, diagnosis and repair of an agent."""

from typing import Literal

Policy = Literal["serp", "planner", "learner", "training"]
"""`serp`: the choice of the trained agent within the vetoes, as by `serp.Run.decide`. `planner`:
the planner only. `learner`: the learner's greedy choice, without planner and veto. `training`:
planner or learner as at the end of training, within the vetoes. None of them explores."""
