"""The commands of `serp`: one module a command, with the attribute `command`."""
