"""Who acts: planner or learner, and what is vetoed."""
