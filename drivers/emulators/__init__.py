"""Separate processes that speak the wire protocols of the real devices."""
