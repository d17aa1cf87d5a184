"""Force sensor: the SRI M3733C behind its M8128-family box."""
