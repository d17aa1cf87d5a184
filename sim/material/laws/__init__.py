"""Constitutive laws, one file each: energy, stress and tangent as Warp functions."""
