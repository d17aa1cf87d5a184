"""Modulus, Poisson's ratio and friction of a gel from forces at depths, and what is not told."""
