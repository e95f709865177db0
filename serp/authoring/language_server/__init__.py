"""PDDL in editors: `serp lsp`."""
