"""The emulated world's gel: a finite-strain model of its own."""
