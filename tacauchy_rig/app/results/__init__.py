"""Pages of runs: the outcome of each, a comparison of two, and a sensor's health over time."""
