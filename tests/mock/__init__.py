"""In-process stand-ins for every device, on a simulated clock."""
