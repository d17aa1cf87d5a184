"""Record a run: check the force sensor, predict the presses, record each trial."""
