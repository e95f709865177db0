"""`serp studio`: a domain file in the browser, and what it means, live."""
