"""Tasks: an environment, its domain file, and the maps between them."""
