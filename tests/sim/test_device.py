"""Devices, and how kernels are put into modules."""

from __future__ import annotations

import logging
import pkgutil
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import warp as wp

import sim
from sim.device import start_warp


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
