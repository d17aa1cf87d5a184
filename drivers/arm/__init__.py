"""Robot arm: UR5, CB3 or e-Series, through ur_rtde."""
