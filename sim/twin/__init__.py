"""A twin of a running press: from its state it presses on to each new force or depth."""
