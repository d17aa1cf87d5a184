"""Data sets of many simulated presses: a plan, its rows, and engines that press them."""
