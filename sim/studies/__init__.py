"""Studies of the simulator; nothing but their commands imports them."""
