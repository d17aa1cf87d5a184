"""The twin of a run: a simulation during, or after, its presses."""
