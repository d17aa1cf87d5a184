"""Robot arm, force sensor and camera behind one set of interfaces."""
