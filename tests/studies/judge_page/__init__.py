"""The page that compares other simulators on the same presses."""
