"""Check whether this computer can make a run; each check names a measurement and a remedy."""
