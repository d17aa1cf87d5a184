"""Shadows that the pressed gel casts on itself."""
