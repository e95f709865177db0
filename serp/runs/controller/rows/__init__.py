"""Model and lookahead for many states at once; modules of the same names above are for one."""
