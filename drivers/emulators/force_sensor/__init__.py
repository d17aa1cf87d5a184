"""An emulated M8128-family box."""
