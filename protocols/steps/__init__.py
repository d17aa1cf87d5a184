"""The steps of a trial, from home to home."""
