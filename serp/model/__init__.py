"""The transition model of a domain file: instantiation, prediction, and what a run learns of it."""
