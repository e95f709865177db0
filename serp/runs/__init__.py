"""The run folder: what one training leaves behind, in open formats. See `serp.runs.folder`."""
