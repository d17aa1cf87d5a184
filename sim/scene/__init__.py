"""A press as plain data: pad, indenter, material, target."""
