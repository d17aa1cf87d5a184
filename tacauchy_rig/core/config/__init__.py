"""rig.toml: reading, checking and explaining it."""
