"""Measure what each setting's F_z is off by, for the file that ``sim.error`` reads."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path

from sim.effects.mesh_choice import mesh_depth
from sim.effects.presets import sectors_of
from sim.error.believed_error import circumstances_of
from sim.error.measured_rows import ForceErrorRow, indenter_kind
from sim.error.section_error import section_error
from sim.error.settings import Setting
from sim.scene.indenter import describe
from sim.scene.scene import Preset
from sim.studies.accuracy.fitted_errors import fits_through
from sim.studies.accuracy.force_limit import COARSENING, ForceLimit, limits_of, pressed_path
from sim.studies.accuracy.press_store import PressStore
from sim.studies.accuracy.training_scenes import TRAINING, Training


def measure_preset_errors(
    file: Path,
    store: PressStore,
    *,
    presses: Sequence[Training] = TRAINING,
    on_progress: Callable[[str], None] = lambda _text: None,
) -> list[ForceErrorRow]:
    """Press every scene with every setting and write the rows to a JSON file; a quarter of an hour.

    Args:
        store: Keeps every press, so that what was killed goes on.

    Raises:
        RigError: A scene cannot be pressed.
    """
    pressed_path(  # compiles the kernels, which no time should hold
        Setting(Preset.FAST, 0.5).applied(presses[0].scene), [1e-5]
    )
    rows: list[ForceErrorRow] = []
    for number, press in enumerate(presses, start=1):
        on_progress(f"{describe(press.scene.indenter)}, nu {press.scene.material.poisson:g}")
        rows += _rows(number, press, store)
    fits = json.dumps({kind: asdict(fit) for kind, fit in fits_through(rows).items()}, indent=1)
    text = ",\n".join(json.dumps(asdict(row)) for row in rows)
    file.write_text(f'{{"fits": {fits},\n"rows": [\n{text}\n]}}\n', "utf-8")
    return rows


def _rows(number: int, press: Training, store: PressStore) -> Iterator[ForceErrorRow]:
    limits = _limits(press, store)
    scene, kind = press.scene, indenter_kind(press.scene.indenter)
    share = circumstances_of(scene, press.indenter)
    for setting in press.settings:
        tried = setting.applied(scene)
        found = store.pressed_path(tried, press.depths_m)
        revolved = setting.preset is not Preset.PAPER
        for depth, force, limit in zip(press.depths_m, found.forces_n, limits, strict=True):
            yield ForceErrorRow(
                press=number,
                kind=kind,
                indenter=describe(scene.indenter),
                poisson=share.poisson,
                radius_share=share.radius_share,
                fillet_share=share.fillet_share,
                preset=setting.preset,
                refinement=setting.refinement,
                sector_count=sectors_of(tried) if revolved else 0,
                depth_m=depth,
                depth_share=depth / mesh_depth(scene),
                pad_share=depth / scene.pad.height_m,
                force_n=force,
                limit_n=limit.force_n,
                doubt=limit.doubt,
                section_error=section_error(tried, depth_m=depth) if revolved else None,
                cpu_s=found.cpu_s,
            )


def _limits(press: Training, store: PressStore) -> tuple[ForceLimit, ...]:
    fine = replace(press.scene, preset=Preset.REFERENCE, refinement=1.0)
    coarse = replace(fine, refinement=1.0 / COARSENING)
    return limits_of(
        press.scene, *(store.pressed_path(scene, press.depths_m) for scene in (fine, coarse))
    )
