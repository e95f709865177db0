"""The report of a comparison: text, tables, figures, and data files."""
