"""Simulators' outputs in plain files: one folder a press; docs/judging.md."""
