"""What the documentation shows works, and what it says of the code is what the code says."""
