"""How well a tool's tilt is found, and what simulating it gains."""
