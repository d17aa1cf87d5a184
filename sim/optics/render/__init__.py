"""From height maps to tactile images."""
