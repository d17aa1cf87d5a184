"""Others' recordings as run folders: what is known of them, and no more."""
