"""The domain language: PDDL text → located errors → ground model → transition model."""
