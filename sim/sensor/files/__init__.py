"""Sensors as data: one TOML file each."""

from pathlib import Path

DIGIT = Path(__file__).with_name("digit.toml")
GELSIGHT_MINI = Path(__file__).with_name("gelsight-mini.toml")
NINE_D_TACT = Path(__file__).with_name("9dtact.toml")
TAXIM_GELSIGHT = Path(__file__).with_name("taxim-gelsight.toml")
TAXIM_GELSIGHT_MINI = Path(__file__).with_name("taxim-gelsight-mini.toml")
