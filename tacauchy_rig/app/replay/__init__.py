"""The work of a run without printing: record, replay, render, report."""
