"""A domain file compared with the transitions of a run, and its repair."""
