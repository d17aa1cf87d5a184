"""The pressing protocol: what moves, when, and what stops it."""
