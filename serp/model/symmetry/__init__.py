"""Permutations of objects that map a transition model onto itself."""
