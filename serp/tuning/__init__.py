"""Tuning settings on a task."""
