"""Optics calibrated from a folder of ball presses, or from a run of them."""
