"""Runs, presses, calibrations and sensors in other programs' formats."""
