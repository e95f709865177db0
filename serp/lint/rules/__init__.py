"""Rules of `serp check`: each looks at a domain and yields warnings."""
