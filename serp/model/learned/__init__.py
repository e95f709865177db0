"""What a run learns of the transition model."""
