"""Modulus, Poisson's ratio and friction of a gel from forces at depths, with what stays open."""
