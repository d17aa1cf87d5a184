"""The body of the control loop, and what it keeps of what it sees."""
