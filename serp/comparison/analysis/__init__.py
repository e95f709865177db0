"""Measures and statistics of finished trials."""
