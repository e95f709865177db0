"""Diagnosis: a domain file compared offline with the transitions of a run."""
