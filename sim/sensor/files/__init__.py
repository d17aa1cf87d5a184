"""Sensors as data: one TOML file each."""
