"""Studies that validate this program itself; no user needs them and the wheel leaves them out."""
