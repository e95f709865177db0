"""unified-planning, in both directions.

`engine` and `selector` offer our planner to unified-planning, `planner` makes its engines planners
of ours: `--planner up:enhsp`.
"""
