"""Pictures of plans, films, and windows."""
