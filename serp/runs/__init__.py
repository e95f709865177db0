"""Runs: training, evaluation, comparison, and the folder that each leaves behind."""
