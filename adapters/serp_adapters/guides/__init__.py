"""Guides: how other systems share the decisions between a planner or teacher and a learner.

Each is a strategy of its own, so that the vetoes hold under it, and an algorithm of `serp compare`.
What each leaves out or changes of its source is said in its file.
"""
