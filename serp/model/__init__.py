"""What a domain file means: instantiated, compiled, and applied to states."""
