"""Repair: the findings of a run written into its domain file."""
