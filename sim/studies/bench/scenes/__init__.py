"""The benchmark's scenes: one press of each kind that a solver has to be fast in."""
