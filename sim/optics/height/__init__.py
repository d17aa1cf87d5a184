"""Height of the gel's surface per pixel, from the deformed mesh."""
