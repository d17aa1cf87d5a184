"""A run for the viewers that labs have, over Foxglove's WebSocket protocol."""
