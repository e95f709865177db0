"""The first files of a new task, for `serp new`."""
