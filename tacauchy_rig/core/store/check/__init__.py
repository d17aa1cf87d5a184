"""What a run says of itself, held against everything in it that can be computed again."""
