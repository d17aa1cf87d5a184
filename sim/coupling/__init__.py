"""Contact between gels and the rigid bodies of a robot simulator, both ways."""
