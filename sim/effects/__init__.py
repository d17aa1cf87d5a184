"""What a scene calls for: the plan of effects, and the presets' meshes and models."""
