"""Counted outcomes: what chance does to predicates and whole numbers."""
