"""Simulators' outputs in plain files: one folder a press; docs/reference/file-formats.md."""
