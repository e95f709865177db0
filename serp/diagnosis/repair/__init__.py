"""Writing the findings of a run back into its domain file."""
