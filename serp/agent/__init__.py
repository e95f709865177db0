"""Who acts: planner or learner, what is vetoed, and why."""
