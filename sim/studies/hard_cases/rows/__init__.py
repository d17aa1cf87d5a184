"""The hard cases, by what they have in common."""
