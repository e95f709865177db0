"""Findings of `serp check`."""
