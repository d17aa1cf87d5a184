"""Other people's recordings as run folders; what they do not state stays unknown."""
