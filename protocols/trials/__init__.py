"""The trials of a run: one attempt from home to home, its verdict, and all of them in order."""
