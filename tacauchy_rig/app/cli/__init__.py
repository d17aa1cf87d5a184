"""Command line: the one place that knows every folder."""
