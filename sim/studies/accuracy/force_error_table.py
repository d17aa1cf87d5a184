"""Measure what each setting's F_z is off by, and fit it: the file that ``sim.error`` reads."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import cast

import numpy as np
import scipy.optimize

from sim.arrays import FloatArray
from sim.effects.mesh_choice import mesh_depth
from sim.effects.presets import sectors_of
from sim.error.measured_errors import ForceErrorRow, Setting, indenter_kind
from sim.error.prior_error import (
    QUANTILE,
    Circumstances,
    ForceErrorFit,
    circumstances_of,
    modelled_errors,
    scatter,
)
from sim.error.section_error import section_error
from sim.scene.indenter import Cylinder, Sphere, describe
from sim.scene.scene import Preset
from sim.studies.accuracy.force_limit import PressStore, pressed_path
from sim.studies.accuracy.scenes import TRAINING, Training

# Keeps an exponent of few presses from running off.
_RIDGE = 2.0
# ln A, ln C and B of an error that is the section's and a little more.
_START = (0.0, 0.0, -6.0)
_DRAWN = (0, 1)


def measure_force_errors(
    file: Path,
    store: PressStore,
    *,
    on_progress: Callable[[str], None] = lambda _text: None,
) -> list[ForceErrorRow]:
    """Press every scene with every setting and write the rows to a JSON file; a quarter of an hour.

    Args:
        store: Keeps every press, so that what was killed goes on.

    Raises:
        RigError: A scene cannot be pressed.
    """
    pressed_path(  # compiles the kernels, which no time should hold
        Setting(Preset.FAST, 0.5).applied(TRAINING[0].scene), [1e-5]
    )
    rows: list[ForceErrorRow] = []
    for number, press in enumerate(TRAINING, start=1):
        on_progress(f"{describe(press.scene.indenter)}, nu {press.scene.material.poisson:g}")
        rows += _measured(number, press, store)
    fits = json.dumps({kind: asdict(fit) for kind, fit in fits_through(rows).items()}, indent=1)
    text = ",\n".join(json.dumps(asdict(row)) for row in rows)
    file.write_text(f'{{"fits": {fits},\n"rows": [\n{text}\n]}}\n', "utf-8")
    return rows


def _measured(number: int, press: Training, store: PressStore) -> Iterator[ForceErrorRow]:
    limits = store.limits(press.scene, press.depths_m)
    scene, kind = press.scene, indenter_kind(press.scene.indenter)
    share = circumstances_of(scene, cast(Cylinder | Sphere, scene.indenter))
    for setting in press.settings:
        tried = setting.applied(scene)
        found = store.pressed_path(tried, press.depths_m)
        revolved = setting.preset is not Preset.PAPER
        for depth, force, limit in zip(press.depths_m, found.forces_n, limits, strict=True):
            yield ForceErrorRow(
                press=number,
                kind=kind,
                indenter=describe(scene.indenter),
                **asdict(share),
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


def fits_through(rows: Sequence[ForceErrorRow]) -> dict[str, ForceErrorFit]:
    """Fit rows, each kind of indenter by itself."""
    revolved = [row for row in rows if row.section_error is not None]
    kinds = dict.fromkeys(row.kind for row in revolved)
    return {kind: fitted([row for row in revolved if row.kind == kind]) for kind in kinds}


def fitted(known: Sequence[ForceErrorRow]) -> ForceErrorFit:
    """Fit rows of one kind of indenter, on revolved meshes."""
    pressed = np.array([(row.poisson, row.radius_share, row.fillet_share) for row in known])
    rows = np.array(
        [
            (
                row.error,
                abs(row.section_error or 0.0),
                float(row.sector_count),
                *_circumstances(each).logarithms,
            )
            for row, each in zip(known, pressed, strict=True)
        ]
    )
    presses = np.array([row.press for row in known])
    beyond = [
        _beyond(_solved(rows[presses != press]), rows[presses == press])
        for press in sorted(set(presses.tolist()))
    ]
    return ForceErrorFit(
        coefficients=tuple(_solved(rows).tolist()),
        margin=float(np.quantile(np.concatenate(beyond), QUANTILE)),
        lowest=_circumstances(pressed.min(axis=0)),
        highest=_circumstances(pressed.max(axis=0)),
        depth_share_least=min(row.depth_share for row in known),
        press_count=len(set(presses.tolist())),
    )


def _circumstances(values: FloatArray) -> Circumstances:
    """Return what an error is in proportion to, from its three numbers."""
    poisson, radius_share, fillet_share = values.tolist()
    return Circumstances(poisson=poisson, radius_share=radius_share, fillet_share=fillet_share)


def _modelled(coefficients: FloatArray, rows: FloatArray) -> FloatArray:
    """Return what a fit gives for rows of error, section's error, sectors and logarithms."""
    return modelled_errors(coefficients, rows[:, 1], rows[:, 2], rows[:, 3:])


def _solved(rows: FloatArray) -> FloatArray:
    """Return the coefficients of the fit; far outliers count less than their squares."""
    errors = rows[:, 0]
    usual = scatter(errors)
    start = np.array([*_START, *np.zeros(rows.shape[1] - 3)])
    drawn = [*_DRAWN, *range(len(_START), len(start))]

    def off(coefficients: FloatArray) -> FloatArray:
        apart = (errors - _modelled(coefficients, rows)) / usual
        return np.concatenate([apart, _RIDGE * (coefficients - start)[drawn]])

    solve: Callable[..., scipy.optimize.OptimizeResult] = scipy.optimize.least_squares
    return np.asarray(solve(off, start, loss="soft_l1").x)


def _beyond(coefficients: FloatArray, rows: FloatArray) -> FloatArray:
    """Return how many scatters rows lie above a fit."""
    middle = _modelled(coefficients, rows)
    return np.asarray((rows[:, 0] - middle) / scatter(middle))
