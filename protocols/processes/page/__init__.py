"""The operator's page: a run in a browser of this computer, and a button to stop it."""
