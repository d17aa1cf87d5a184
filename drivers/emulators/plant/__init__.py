"""The gel as the emulated world has it: force and image from the pose of the indenter."""
