"""Samples of images in a device's memory, for kernels on blocks of pixels."""
