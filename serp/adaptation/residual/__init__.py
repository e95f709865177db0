"""Online regression of what the domain file leaves unexplained."""
