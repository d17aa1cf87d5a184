"""Equilibrium of a clamped pad under contact."""
