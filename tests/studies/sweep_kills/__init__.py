"""Sweeps that are killed."""
