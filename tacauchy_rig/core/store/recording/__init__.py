"""Recordings: one crash-safe MCAP file an attempt."""
