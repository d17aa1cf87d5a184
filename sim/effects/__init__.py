"""The plan of a scene's effects, and the presets' meshes and models."""
