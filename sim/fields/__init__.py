"""What a press leaves behind: stress, traction, contact force, surface."""
