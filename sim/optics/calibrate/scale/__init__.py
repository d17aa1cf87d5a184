"""Where pixels look: the scale of a sensor's images."""
