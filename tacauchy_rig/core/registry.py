"""What can be chosen by name: ours, and what other packages bring.

A package adds to a kind by an entry point of the group ``tacauchy_rig.<kind>``
(docs/how-to/add-an-effect-or-study.md). Ours stand in a table in place of this project's own entry
points, in the same form: so a source tree works without being installed again, and nothing is
imported before it is asked for. The names in the table cannot be taken by another package.
"""

import json
from enum import StrEnum
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from tacauchy_rig.core.errors import ConfigError


class Kind(StrEnum):
    """What is chosen by name; the value ends the group's name."""

    ARM = "arms"
    FORCE_SENSOR = "force_sensors"
    CAMERA = "cameras"
    LAW = "laws"
    INDENTER = "indenters"
    SENSOR = "sensors"
    RENDERER = "renderers"

    @property
    def group(self) -> str:
        """Group of entry points that adds to this kind."""
        return f"tacauchy_rig.{self.value}"

    @property
    def noun(self) -> str:
        """One of them, in words."""
        return self.value.removesuffix("s").replace("_", " ")


_OWN: dict[Kind, dict[str, str]] = {
    Kind.ARM: {
        "ur5": "drivers.arm.ur5_motion_and_watchdog:Ur5",
        "emulated": "drivers.arm.ur5_motion_and_watchdog:Ur5",
    },
    Kind.FORCE_SENSOR: {
        "m3733c": "drivers.force_sensor.sri_m3733c:SriM3733c",
        "emulated": "drivers.force_sensor.sri_m3733c:SriM3733c",
    },
    Kind.CAMERA: {
        "uvc": "drivers.camera.uvc_camera:UvcCamera",
        "emulated": "drivers.camera.uvc_camera:UvcCamera",
    },
    Kind.LAW: {
        "stable-neo-hookean": "sim.material.laws.stable_neo_hookean:LAW",
        "neo-hookean": "sim.material.laws.neo_hookean:LAW",
        "linear": "sim.material.laws.linear:LAW",
        "paper-eq4": "sim.material.laws.paper_eq4:LAW",
    },
    Kind.INDENTER: {
        "cylinder": "sim.scene.scene_parsing:parse_cylinder",
        "sphere": "sim.scene.scene_parsing:parse_sphere",
        "plane": "sim.scene.scene_parsing:parse_plane",
        "object": "sim.scene.objects:parse_object",
        "mesh": "sim.scene.scene_parsing:parse_mesh",
    },
    Kind.SENSOR: {
        "9dtact": "sim.sensor.files:NINE_D_TACT",
        "digit": "sim.sensor.files:DIGIT",
        "gelsight-mini": "sim.sensor.files:GELSIGHT_MINI",
        "taxim-gelsight": "sim.sensor.files:TAXIM_GELSIGHT",
        "taxim-gelsight-mini": "sim.sensor.files:TAXIM_GELSIGHT_MINI",
    },
    Kind.RENDERER: {
        "photometric": "sim.optics.colour.nominal_optics:PHOTOMETRIC",
        "grey-depth": "sim.optics.colour.nominal_optics:GREY_DEPTH",
    },
}


def names(kind: Kind) -> list[str]:
    """Return what can be chosen: ours in the table's order, then those of other packages.

    Raises:
        ConfigError: Two other packages bring the same name.
    """
    own = list(_OWN[kind])
    return own + sorted(name for name in _brought(kind) if name not in own)


def load(kind: Kind, name: str) -> Any:
    """Import what ``name`` stands for.

    Raises:
        ConfigError: The name is unknown, or what another package brings does not import.
    """
    if name in _OWN[kind]:
        return EntryPoint(name, _OWN[kind][name], kind.group).load()
    entry = _brought(kind).get(name)
    if entry is None:
        raise ConfigError(
            f"{kind.noun} {unknown(kind, name)}",
            remedy=f"correct the name, or install the package that brings it ({kind.group})",
        )
    try:
        return entry.load()
    except Exception as error:
        raise ConfigError(
            f'{kind.noun} "{name}" of the package {_package(entry)} does not import '
            f"({entry.value}): {type(error).__name__}: {error}",
            remedy="correct that package or install it again; nothing else needs it",
        ) from error


def unknown(kind: Kind, name: object) -> str:
    """Return that there is no such name, and what there is; empty where there is one."""
    if name in _OWN[kind]:
        return ""
    known = names(kind)
    choices = ", ".join(f'"{each}"' for each in known)
    return "" if name in known else f"{json.dumps(name, default=str)} is none of {choices}"


def _brought(kind: Kind) -> dict[str, EntryPoint]:
    found: dict[str, EntryPoint] = {}
    for entry in entry_points(group=kind.group):
        other = found.setdefault(entry.name, entry)
        if other.value != entry.value:
            raise ConfigError(
                f'{kind.noun} "{entry.name}" is brought by both {_package(other)} and '
                f"{_package(entry)}",
                remedy="uninstall one of the two packages",
            )
    return found


def _package(entry: EntryPoint) -> str:
    return "unknown" if entry.dist is None else f"{entry.dist.name} {entry.dist.version}"
