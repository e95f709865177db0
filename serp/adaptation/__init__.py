"""Model adaptation: what a run learns online about the transition model."""
