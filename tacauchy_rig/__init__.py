"""From a recorded press on a tactile sensor to a replay matched in force and an honest report."""

__version__ = "0.1.0"
