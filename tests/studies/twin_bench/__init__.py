"""How a twin keeps up with emulated runs, and what it costs them."""
