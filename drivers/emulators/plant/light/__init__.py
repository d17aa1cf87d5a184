"""The emulated camera's optics."""
