"""Whether one press tells an aged sensor from a new one."""
