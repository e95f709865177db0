"""Commands that train, or lead to a training."""
