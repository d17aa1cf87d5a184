"""What the program does: sessions, replay, calibration, imports, judging, and the command line."""
