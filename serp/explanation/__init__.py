"""The one account of a decision, in the words of the file; see `serp.explanation.decision`."""
