"""The simulator against itself: balance, drives, shifts, and its own error estimates."""
