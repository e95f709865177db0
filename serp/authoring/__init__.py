"""Writing domain files: lint, format, scenarios, play, scaffold, language server."""
