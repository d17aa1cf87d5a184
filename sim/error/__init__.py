"""What a simulated force is worth."""
