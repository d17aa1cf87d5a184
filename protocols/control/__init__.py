"""The body of the control loop, and its records."""
