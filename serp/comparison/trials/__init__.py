"""One trial of a comparison: train one algorithm with one seed, and evaluate it."""
