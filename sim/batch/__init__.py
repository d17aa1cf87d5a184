"""Many presses of one rest mesh at once, on a GPU without host round trips, or on the CPU."""
