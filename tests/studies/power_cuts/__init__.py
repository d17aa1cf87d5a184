"""What a power cut can leave of a run: every such state leads back to a whole run."""
