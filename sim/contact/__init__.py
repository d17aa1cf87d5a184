"""Barrier contact and friction between the gel's surface and a rigid indenter."""
