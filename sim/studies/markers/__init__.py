"""Marker motion by the simulated surface beside cheaper ways of it."""
