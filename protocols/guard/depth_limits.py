"""How deep the tip may go: in the search for the gel, and below contact in a press."""

from typing import NamedTuple

from protocols.guard.breach_reaction import BreachError, Reaction
from tacauchy_rig.core.config.settings import RigConfig

BEYOND_M = 0.0002
"""How far below the lowest surface that is known the search goes on: the way of the softest gel to
the contact force, and what an arm does not repeat (CB3 0.1 mm)."""


class Floor(NamedTuple):
    """How low a search may go [m], and which setting says so."""

    height_m: float
    limit: str

    def check(self, z_m: float, *, is_late: bool) -> None:
        """Stop a search at a height [m] below the floor, or one that takes too long.

        Raises:
            BreachError: Nothing was touched.
        """
        if z_m < self.height_m or is_late:
            raise BreachError(
                f"{self.limit}: nothing was touched down to z = {z_m * 1e3:.2f} mm",
                limit=self.limit,
                reaction=Reaction.RETRACT,
                remedy="the force sensor sticks or reads far too little: hang a known weight on "
                "it; or the sensor is not under the indenter: check sensor.surface, and whether it "
                "was moved since an earlier trial (then begin a new run)",
            )


def search_floor(config: RigConfig, *, start_m: float, contact_m: float | None) -> Floor:
    """Return the highest floor that is known.

    Args:
        start_m: Height where the search begins [m].
        contact_m: Height of contact in an earlier trial [m], if there was one.
    """
    protocol, sensor = config.protocol, config.sensor
    lowest_m = sensor.surface[2] - sensor.surface_uncertainty - BEYOND_M
    floors = [
        Floor(start_m - protocol.search_travel, "protocol.search_travel"),
        Floor(lowest_m, "sensor.surface_uncertainty"),
    ]
    if contact_m is not None:
        floors.append(Floor(contact_m - BEYOND_M, "witness.contact_height"))
    return max(floors, key=lambda floor: floor.height_m)


class DepthGuard:
    """Stops a press that goes below ``limits.max_depth``, or deeper than its force justifies.

    Args:
        target_n: Force that is pressed to [N].
        needed_m: Depth that the stated gel needs for it at most [m]; infinite if that is not known.
    """

    def __init__(self, config: RigConfig, *, target_n: float, needed_m: float) -> None:
        self._limit_m, self._target_n = config.limits.max_depth, target_n
        self._deepest_m = min(self._limit_m, needed_m)

    def check(self, depth_m: float, *, force_n: float) -> None:
        """Compare the depth below contact [m]; the force [N] is for the message.

        Raises:
            BreachError: The tip is too deep.
        """
        if depth_m <= self._deepest_m:
            return
        where = f"the tip is {depth_m * 1e3:.3f} mm below contact at {force_n:.3f} N"
        if self._deepest_m < self._limit_m:
            raise BreachError(
                f"witness: {where}; the stated gel needs no more than {self._deepest_m * 1e3:.3f} "
                f"mm for {self._target_n:g} N",
                limit="witness.depth",
                reaction=Reaction.RETRACT,
                remedy="the force sensor reads too little: hang a known weight on it; or the gel "
                "is softer than sensor.name says",
            )
        raise BreachError(
            f"limits.max_depth {self._limit_m * 1e3:g} mm: {where}",
            limit="limits.max_depth",
            reaction=Reaction.RETRACT,
            remedy="the gel is softer than expected, or contact was found on something else",
        )
