"""PDDL in editors: what is known of a place in a file, over the Language Server Protocol."""
