"""Online regression of the one-step error of the domain file."""
