"""What an expert expects in a situation, checked by `serp test`."""
