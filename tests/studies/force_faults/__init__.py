"""Slow and late faults of force sensor and arm, in simulated time."""
