"""Marker motion by exponentials: the cheap fidelity beside the simulated surface.

After FOTS (Zhao et al., FOTS: A Fast Optical Tactile Simulator for Sim2Real Learning of
Tactile-motor Robot Manipulation Skills, RA-L 2024): dilation, shear and twist each
move a marker by an amount that decays with a Gaussian of its distance. The turn is exact: at an
angle of zero, cos(theta) - 1 and sin(theta) are zero.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from scipy.optimize import least_squares

from sim.arrays import FloatArray
from sim.scene.scene import Scene

# Where a fit starts: gain and decay of dilation, of shear and of twist.
_START = (50.0, 1e5, 1.0, 1e5, 1.0, 1e5)


@dataclass(frozen=True, slots=True, kw_only=True)
class FotsMarkers:
    """Gains and decays of the three motions.

    Attributes:
        dilate_gain: Spreading per depth and distance from the centre [1/m].
        dilate_decay: In exp(-decay r^2) [1/m^2]; likewise the next two.
        shear_gain: Share of the indenter's motion that the gel follows.
        shear_decay: [1/m^2].
        twist_gain: Share of the indenter's turn that the gel follows.
        twist_decay: [1/m^2].
    """

    dilate_gain: float
    dilate_decay: float
    shear_gain: float
    shear_decay: float
    twist_gain: float
    twist_decay: float

    def displacement(self, places: FloatArray, scene: Scene) -> FloatArray:
        """Return the markers' displacement along x, y [m], shape [n, 2].

        Args:
            places: Markers at rest [m], shape [n, 2].
        """
        arm = places - np.asarray(scene.centre_m)
        depth_m, motion = scene.target.depth_m or 0.0, scene.motion
        squared = np.sum(arm**2, axis=1, keepdims=True)
        spread = self.dilate_gain * depth_m * arm * np.exp(-self.dilate_decay * squared)
        shear = self.shear_gain * np.asarray(motion.shift_m) * np.exp(-self.shear_decay * squared)
        angle = self.twist_gain * motion.twist_rad
        turn = np.array(
            [[math.cos(angle) - 1.0, -math.sin(angle)], [math.sin(angle), math.cos(angle) - 1.0]]
        )
        twist = (arm @ turn.T) * np.exp(-self.twist_decay * squared)
        return np.asarray(spread + shear + twist)


def fit_fots(
    places: FloatArray, scenes: Sequence[Scene], displacements: Sequence[FloatArray]
) -> FotsMarkers:
    """Fit the six numbers to displacements that are known, from the simulator or from images.

    Args:
        places: Markers at rest [m], shape [n, 2].
        scenes: At least one of each motion that is to be fitted.
        displacements: Along x, y in each scene [m], each of shape [n, 2].
    """
    names = [field.name for field in fields(FotsMarkers)]

    def model(factors: FloatArray) -> FotsMarkers:
        return FotsMarkers(**dict(zip(names, (factors * _START).tolist(), strict=True)))

    def misfit(factors: FloatArray) -> FloatArray:
        trial = model(factors)
        return np.concatenate(
            [
                (trial.displacement(places, scene) - known).ravel() * 1e6
                for scene, known in zip(scenes, displacements, strict=True)
            ]
        )

    return model(least_squares(misfit, np.ones(len(names)), bounds=(0.0, np.inf)).x)
