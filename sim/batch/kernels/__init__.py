"""Warp kernels of a batch."""
