"""Tasks as Gymnasium environments, for learners that bring their own training loop."""
