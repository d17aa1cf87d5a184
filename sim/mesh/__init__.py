"""Tetrahedral meshes of a pad: the type, its elements, and how they are made."""
