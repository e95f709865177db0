"""Diagnosis: what a run says about its domain file, offline."""
