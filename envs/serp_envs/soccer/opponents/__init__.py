"""Scripted opponents."""
