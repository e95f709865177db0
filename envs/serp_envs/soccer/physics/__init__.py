"""The physics of robot soccer: pitch, ball, robots."""
