"""Engines that run the trials of a comparison on the machines of a cluster."""
