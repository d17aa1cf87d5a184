"""Tactile sensors inside simulators of robots."""
