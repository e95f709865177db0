"""Commands about what a training left behind: its record, its model, its policy."""
