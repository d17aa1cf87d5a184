"""A page of runs: what each came to, two beside each other, and a sensor's health over time."""
