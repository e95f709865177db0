"""Worlds made of domain files, without an environment of their own."""
