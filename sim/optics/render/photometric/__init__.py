"""Photometric model: tilt and place of the surface to a change of colour."""
