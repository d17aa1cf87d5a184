"""A search for the pad and l_r that would give the paper's mesh table."""
