"""Reference numbers as data, each file with its source."""
