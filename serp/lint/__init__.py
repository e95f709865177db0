"""Warnings about domain files that are correct PDDL and may still be mistaken."""
