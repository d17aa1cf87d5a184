"""Devices, GPUs among them, and how kernels are put into modules."""

import logging
import pkgutil
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp

import sim
from sim.batch import contact_inverse_kernels, dense_inverse_kernels, motion_step_kernels
from sim.batch.contact_inverse_kernels import correct_kernels
from sim.batch.dense_kernel import Tiling, product_kernel
from sim.device import start_warp
from sim.press import press
from sim.scene.indenter import Cylinder, Sphere
from sim.scene.material import LawName, Layer, Material, RelaxationTerm
from sim.scene.pad import BoxPad
from sim.scene.scene import ContactMode, Effect, Motion, Preset, Scene, Target
from sim.solve.descent_kernels import descent_kernels


@wp.kernel(enable_backward=False, module="unique")
def set_to_one(values_out: wp.array(dtype=wp.float32)) -> None:  # type: ignore[valid-type]
    """Write ones."""
    values_out[wp.tid()] = wp.float32(1.0)  # type: ignore[index]


def test_a_compiled_module_is_told_with_its_time_and_a_cached_one_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """An empty cache makes Warp compile, and the record has the seconds; then nothing is new."""
    start_warp()
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    caplog.set_level(logging.INFO, logger="sim.device.compiled")
    values: Any = wp.zeros(3, dtype=wp.float32, device="cpu")
    for _ in range(2):
        wp.launch(set_to_one, dim=3, outputs=[values], device="cpu")
    assert values.numpy().tolist() == [1.0, 1.0, 1.0]
    (record,) = caplog.records
    assert "set_to_one" in record.getMessage()
    assert record.__dict__["compiled_s"] > 0.0


def test_a_generic_kernel_shares_its_module_with_none() -> None:
    """Its first launch adds to the module: all kernels in it would be compiled again."""
    places = [each.name for each in pkgutil.walk_packages(sim.__path__, "sim.")]
    modules = [import_module(name) for name in places if name.endswith(("_kernel", "_kernels"))]
    kernels = [value for each in modules for value in vars(each).values()]
    generic = [each for each in kernels if isinstance(each, wp.Kernel) and each.is_generic]
    assert len(generic) > 5
    assert [each.key for each in generic if len(each.module.kernels) > 1] == []


_GEL = Material(young_pa=0.435e6, poisson=0.48)
_PRESS = Scene(
    pad=BoxPad(size_x_m=20.75e-3, size_y_m=25.25e-3, height_m=4e-3),
    material=_GEL,
    indenter=Cylinder(diameter_m=5e-3, fillet_m=0.1e-3),
    target=Target(force_n=1.2556),
    preset=Preset.FAST,
)
_BALL = replace(_PRESS, indenter=Sphere(diameter_m=8e-3), target=Target(depth_m=0.6e-3))
_FINITE = ((Effect.FINITE_STRAIN, True),)
_SLOW_GEL = replace(_GEL, relaxation=(RelaxationTerm(share=0.3, time_s=0.5),))
_SKIN = Layer(share=0.1, material=replace(_GEL, young_pa=1e6))
SCENES = {
    "cylinder to a force": _PRESS,
    "ball to a depth": _BALL,
    "bonded": replace(_PRESS, contact=ContactMode.BONDED),
    "ball slid with friction": replace(
        _BALL, contact=ContactMode.FRICTION, friction=0.5, motion=Motion(shift_m=(1e-4, 0.0))
    ),
    "linear tetrahedra": replace(_BALL, effects=((Effect.LOCKING_FREE_ELEMENT, False),)),
    "isochoric law": replace(
        _BALL, material=replace(_GEL, law=LawName.NEO_HOOKEAN), effects=_FINITE
    ),
    "relaxing gel": replace(_BALL, material=_SLOW_GEL),
    "two layers": replace(_BALL, layers=(Layer(share=0.9, material=_GEL), _SKIN)),
}


@pytest.mark.slow
def test_cuda_code_compiles_without_a_gpu(tmp_path: Path) -> None:
    """Warp brings NVIDIA's compiler, which needs neither a GPU nor a driver."""
    kernels = [product_kernel(Tiling(row_tiles=1, column_tiles=1, depth_warps=8))]
    kernels += [*correct_kernels(wp.float16), *descent_kernels(grips=True, pulls=True, threads=256)]
    wp.overload(kernels[-2], {"sources_out": wp.array2d(dtype=wp.float16)})
    wp.overload(kernels[-1], {"found": wp.array2d(dtype=wp.float32)})
    for module in (contact_inverse_kernels, dense_inverse_kernels, motion_step_kernels):
        kernels += [each for each in vars(module).values() if isinstance(each, wp.Kernel)]
    modules = {each.module.name: each.module for each in kernels}
    for module in modules.values():
        wp.compile_aot_module(module, arch=90, module_dir=tmp_path, use_ptx=True)
    assert len(list(tmp_path.glob("*.sm90.ptx"))) == len(modules)


@pytest.mark.gpu
@pytest.mark.parametrize("name", SCENES)
def test_cuda_and_cpu_agree(name: str) -> None:
    """F_z, depth and the largest pressure on both devices agree to 1e-6; slid ones to 3e-6.

    Every step balances to 1e-6 of the force, and what slid in one is where the next begins.
    """
    allowed = 3e-6 if "slid" in name else 1e-6
    host, device = press(SCENES[name]), press(SCENES[name], device="cuda:0")
    assert device.model.device == "cuda:0"
    assert host.force_n[2] == pytest.approx(device.force_n[2], rel=allowed)
    assert host.depth_m == pytest.approx(device.depth_m, rel=allowed)
    assert np.isclose(host.max_pressure_pa, device.max_pressure_pa, rtol=1e-5)
