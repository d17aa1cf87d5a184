"""The report of a run against replays that are wrong on purpose: what its verdict catches."""
