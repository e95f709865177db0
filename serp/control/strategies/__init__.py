"""Ways in which planner and learner share the decisions, one a file."""
