"""What accuracy costs in time: one press with many settings, each against a reference."""
