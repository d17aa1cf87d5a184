"""Sensors as data: one TOML file each, read and checked."""
