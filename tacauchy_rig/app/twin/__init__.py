"""The twin of a run: what the simulator shows while, or after, a gel is pressed."""
