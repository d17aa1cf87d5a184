"""A laboratory's own devices and models, outside of the repository."""

from pathlib import Path

from sim.scene.indenter import Sphere

SKIN = Path(__file__).with_name("skin.toml")


def lab_ball(_sizes: str) -> Sphere:
    """Return the ball that lies in the drawer: ``--indenter lab-ball``."""
    return Sphere(diameter_m=0.008)
