"""What stops the arm: limits on force, streams, place, following, and people."""
