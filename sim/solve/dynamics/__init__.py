"""Presses in time: inertia and weight."""
