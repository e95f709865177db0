"""Playing a domain file by hand: its world, one step at a time."""
