"""How far a value of ``rig.toml`` may go on any rig, and why.

A value may be well formed and still be one that no arm, cell or gel can honour: a limit so wide
that it never stops anything is refused here, not met on the rig. What depends on the run's gel is
in ``tacauchy_rig.loop.gel_limits``; what ties two fields together in ``tacauchy_rig.config.rules``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from tacauchy_rig.quantities import Dimension, parse_quantity


@dataclass(frozen=True, slots=True, kw_only=True)
class Ceiling:
    """The range of one field.

    Attributes:
        least: Smallest value, as it is written; None where the field's type is enough.
        most: Largest value, likewise.
        because: Reason, as a clause that follows a semicolon.
    """

    dimension: Dimension
    because: str
    least: str | None = None
    most: str | None = None

    def crossed(self, value: float) -> tuple[str, float] | None:
        """Return ``"le"`` or ``"ge"`` and the bound [SI] that ``value`` [SI] is beyond, if any."""
        for name, bound, sign in (("le", self.most, 1.0), ("ge", self.least, -1.0)):
            if bound is not None:
                limit = parse_quantity(bound, dimension=self.dimension)
                if sign * value > sign * limit:
                    return name, limit
        return None


_REACH = Ceiling(
    dimension=Dimension.LENGTH,
    least="-1000 mm",
    most="1000 mm",
    because="a UR5 reaches 850 mm, and a tool adds little to that",
)
_CARRIED = "a UR5 carries 5 kg, which weigh 49 N"
_REACTION = "the loop and the arm need about 50 ms to stand still"

CEILINGS: Mapping[str, Mapping[str, Ceiling]] = {
    "robot": {
        "payload": Ceiling(dimension=Dimension.MASS, most="5 kg", because="a UR5 carries no more"),
        "approach_speed": Ceiling(
            dimension=Dimension.SPEED,
            most="10 mm/s",
            because=f"{_REACTION}: 0.5 mm of the approach_height of 2 mm",
        ),
        "search_speed": Ceiling(
            dimension=Dimension.SPEED,
            most="1 mm/s",
            because=f"{_REACTION}: 0.05 mm into the gel at first contact",
        ),
        "press_speed": Ceiling(
            dimension=Dimension.SPEED,
            most="0.5 mm/s",
            because=f"{_REACTION}: 25 um, some 0.2 N on a GelSight Mini",
        ),
        "retract_speed": Ceiling(
            dimension=Dimension.SPEED,
            most="20 mm/s",
            because="a gel sticks; faster it is torn off rather than let go",
        ),
        "acceleration": Ceiling(
            dimension=Dimension.ACCELERATION,
            most="1 m/s^2",
            because="at 20 mm/s it brings the arm to rest in 20 ms; a harder stop only shakes it",
        ),
    },
    "force_sensor": {
        "capacity": Ceiling(
            dimension=Dimension.FORCE,
            most="500 N",
            because="one count of a 16-bit box would be 0.015 N, half of the usual force_tolerance",
        ),
    },
    "sensor": {
        "surface_uncertainty": Ceiling(
            dimension=Dimension.LENGTH,
            most="10 mm",
            because="with more the arm would search beside and below the gel's frame",
        ),
    },
    "workspace": {
        **{f"{axis}_{end}": _REACH for axis in "xyz" for end in ("min", "max")},
        "max_tilt": Ceiling(
            dimension=Dimension.ANGLE,
            most="10 deg",
            because="the cell then misses 1.5 % of the force, and a flat indenter meets the gel "
            "with its edge",
        ),
        "home_radius": Ceiling(
            dimension=Dimension.LENGTH,
            most="100 mm",
            because="the way from there to home is straight, whatever stands in it",
        ),
    },
    "limits": {
        "soft_force": Ceiling(dimension=Dimension.FORCE, most="50 N", because=_CARRIED),
        "hard_force": Ceiling(dimension=Dimension.FORCE, most="50 N", because=_CARRIED),
        "lateral_force": Ceiling(
            dimension=Dimension.FORCE,
            most="20 N",
            because="sideways force shears the gel off its window; a straight press has next to "
            "none",
        ),
        "moment": Ceiling(
            dimension=Dimension.TORQUE,
            most="2 N m",
            because="that is 50 N, 40 mm beside the axis",
        ),
        "force_rate": Ceiling(
            dimension=Dimension.FORCE_RATE,
            most="500 N/s",
            because="it adds 25 N in the 50 ms until the arm stands still",
        ),
        "early_contact": Ceiling(
            dimension=Dimension.FORCE,
            most="5 N",
            because="nothing should be touched there: it is the largest press of the paper",
        ),
        "max_depth": Ceiling(
            dimension=Dimension.LENGTH,
            most="10 mm",
            because="no known gel is as thick",
        ),
        "corrupt_ratio": Ceiling(
            dimension=Dimension.RATIO,
            most="20 %",
            because="with more frames lost the guard sees too little",
        ),
        "repeat_count": Ceiling(
            dimension=Dimension.RATIO,
            most="100",
            because="that is 1 s of a stuck cell at 100 Hz",
        ),
    },
    "protocol": {
        "force_targets": Ceiling(dimension=Dimension.FORCE, most="50 N", because=_CARRIED),
        "force_tolerance": Ceiling(
            dimension=Dimension.FORCE,
            most="1 N",
            because="a coarser press says nothing of a model",
        ),
        "contact_force": Ceiling(
            dimension=Dimension.FORCE,
            most="1 N",
            because="it decides where depth zero is",
        ),
        "approach_height": Ceiling(
            dimension=Dimension.LENGTH, most="20 mm", because="search goes that way slowly"
        ),
        "air_press_height": Ceiling(
            dimension=Dimension.LENGTH, most="100 mm", because="20 mm clear any gel"
        ),
        "search_travel": Ceiling(
            dimension=Dimension.LENGTH,
            most="20 mm",
            because="a gel that is not met by then is not where sensor.surface says",
        ),
        "tare_duration": Ceiling(
            dimension=Dimension.TIME, most="60 s", because="a cell drifts within a minute"
        ),
        "tare_deviation": Ceiling(
            dimension=Dimension.FORCE, most="0.5 N", because="a quiet cell has 0.01 N of noise"
        ),
        "tare_mean": Ceiling(
            dimension=Dimension.FORCE,
            most="50 N",
            because="a tool that a UR5 carries weighs no more",
        ),
        "reference_duration": Ceiling(
            dimension=Dimension.TIME, most="60 s", because="the zero drifts meanwhile"
        ),
        "settle_timeout": Ceiling(
            dimension=Dimension.TIME, most="300 s", because="a gel has crept by then"
        ),
        "dwell_duration": Ceiling(
            dimension=Dimension.TIME, most="300 s", because="cells drift by 0.1 N in 180 s"
        ),
        "dwell_force_rate": Ceiling(
            dimension=Dimension.FORCE_RATE,
            most="1 N/s",
            because="at that rate nothing has settled",
        ),
        "drift": Ceiling(
            dimension=Dimension.FORCE,
            most="1 N",
            because="a zero that wanders so far is a broken cell",
        ),
        "press_timeout": Ceiling(
            dimension=Dimension.TIME, most="600 s", because="0.01 mm/s reach 6 mm by then"
        ),
        "attempts": Ceiling(
            dimension=Dimension.RATIO,
            most="10",
            because="what fails ten times needs a person",
        ),
    },
    "replay": {
        "force_tolerance": Ceiling(
            dimension=Dimension.FORCE,
            most="1 N",
            because="a replay at another force is no replay",
        ),
    },
    "report": {
        "max_force_mismatch": Ceiling(
            dimension=Dimension.FORCE,
            most="1 N",
            because="a replay at another force is no replay",
        ),
        "max_contact_residual": Ceiling(
            dimension=Dimension.RATIO,
            most="0.7",
            because="1 is what showing no contact leaves, and 0.7 leaves half of its square",
        ),
        "max_contact_offset": Ceiling(
            dimension=Dimension.LENGTH,
            most="1 mm",
            because="a contact that is further off is another press",
        ),
        "coverage_factor": Ceiling(
            dimension=Dimension.RATIO,
            most="3",
            because="3 covers 99.7 % of what is known to be uncertain",
        ),
    },
}
"""By table and field."""

NO_CEILINGS: Mapping[str, Ceiling] = MappingProxyType({})


def ceilings() -> Iterator[tuple[str, Ceiling]]:
    """Yield dotted field and range, in the order of the file."""
    for table, fields in CEILINGS.items():
        for field, ceiling in fields.items():
            yield f"{table}.{field}", ceiling
