"""Compare a sensor's presses over time: keep, recalibrate or replace the gel."""
