"""Height maps and tactile images from a deformed gel."""
