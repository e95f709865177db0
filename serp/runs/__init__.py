"""Training, evaluation, comparison, tuning, records, diagnosis and repair of an agent."""

from typing import Literal

Policy = Literal["serp", "planner", "learner"]
"""`serp`: the choice of the trained agent within the vetoes, as by `serp.Run.decide`. `planner`:
the planner only. `learner`: the learner's greedy choice, without planner and veto. None of them
explores."""
