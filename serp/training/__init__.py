"""Training, evaluation, and the runs that they make."""
