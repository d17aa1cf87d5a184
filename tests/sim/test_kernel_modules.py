"""How kernels are put into modules, which Warp compiles as wholes."""

from __future__ import annotations

import pkgutil
from importlib import import_module

import warp as wp

import sim


def test_a_generic_kernel_shares_its_module_with_none() -> None:
    """Its first launch adds to the module: all kernels in it would be compiled again."""
    places = [each.name for each in pkgutil.walk_packages(sim.__path__, "sim.")]
    modules = [import_module(name) for name in places if name.endswith(("_kernel", "_kernels"))]
    kernels = [value for each in modules for value in vars(each).values()]
    generic = [each for each in kernels if isinstance(each, wp.Kernel) and each.is_generic]
    assert len(generic) > 5
    assert [each.key for each in generic if len(each.module.kernels) > 1] == []
