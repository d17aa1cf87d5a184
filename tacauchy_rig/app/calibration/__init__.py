"""Calibrate optics, the gel's material and the delays of streams."""
