"""Whether the split of an image residual names the cause that was planted."""
