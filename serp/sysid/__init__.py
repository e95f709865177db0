"""System identification: regressions that estimate a transition model from observed transitions."""
