"""Finite-element replay of presses on tactile sensors, and the images they give."""
