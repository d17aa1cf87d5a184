"""The benchmark's scenes by another commit's solver and by this one's, in turns."""
