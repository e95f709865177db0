"""What a run has seen of the world beside what the domain file says of it, and what follows."""
