"""The standing benchmark: how long the simulator's work takes, in parts and as it grows."""
