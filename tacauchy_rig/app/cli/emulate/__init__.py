"""Emulated devices by themselves, for a ``run`` in another terminal."""
