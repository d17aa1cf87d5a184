"""Loading paths: the indenter advanced, carried and turned in steps."""
