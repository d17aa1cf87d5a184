"""Calibration of a sensor's optics from ball presses."""
