"""Fields of a press: stress, traction, contact force, surface."""
