"""PDDL text: reading it with the place of every word, and editing it."""
