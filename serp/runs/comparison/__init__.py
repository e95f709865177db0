"""Comparing algorithms on one task under one protocol: `serp compare`."""
