"""A lab's folder of presses, from ``import --init`` to the report."""
