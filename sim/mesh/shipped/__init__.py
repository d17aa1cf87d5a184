"""Meshes that ship with the program, because fTetWild gives another one every time it runs."""
