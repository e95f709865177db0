"""Commands about a domain file: write it, see what it means, try it, check it."""
