"""Presses beyond what a gel can bear: right, or an error, and never silent."""
