"""Printed markers: where they are, where the gel carries them, how they are tracked."""
