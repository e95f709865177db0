"""Export of a run's policy, for a robot without serp."""
