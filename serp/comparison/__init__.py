"""Comparing algorithms on one task, on equal terms: `serp compare`."""
