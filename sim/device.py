"""Arrays and kernel launches on one Warp device, and what Warp logs."""

import ctypes
import logging
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from tacauchy_rig.core.errors import ConfigError

logger = logging.getLogger(__name__)
# Of its own, so that who wants to hear of compiled kernels need not hear the rest.
compiled = logging.getLogger(f"{__name__}.compiled")

# Of a module that was compiled; Warp says "(cached)" of one that only had to be loaded.
_COMPILED = re.compile(r"^Module (?P<name>\S+) .* took (?P<ms>[\d.]+) ms\s+\(compiled\)")


class WarpLog:
    """A logger for Warp: compiled modules go to ``sim.device.compiled``, with ``compiled_s``."""

    debug = staticmethod(logger.debug)
    error = staticmethod(logger.error)

    def info(self, message: str) -> None:
        """Tell of a module that was compiled; the rest is for debugging."""
        if found := _COMPILED.match(message):
            seconds = 1e-3 * float(found["ms"])
            compiled.info("compiled %s", found["name"], extra={"compiled_s": seconds})
        else:
            logger.debug("%s", message)

    def warning(self, message: str, category: object = None, stacklevel: int = 1) -> None:
        """Pass on a warning."""
        del category
        logger.warning("%s", message, stacklevel=stacklevel + 1)


# Products and sums in one instruction; and with Warp's own flags no block of pixels is put whole
# into one (``sim/optics/pixels/blur_and_exposure_kernel.py``). One set of
# flags for all kernels: a process that compiles reads Warp's headers once for each, in 3 s.
wp.config.cpu_compiler_flags = (
    "-march=native -ffp-contract=fast -mllvm -inline-threshold=9000"
    " -mllvm -slp-recursion-max-depth=12"
)
# Relative rounding of what the kernels compute; the host computes in float64.
KERNEL_EPSILON = float(np.finfo(wp.dtype_to_numpy(wp.float64)).eps)  # type: ignore[no-untyped-call]

# Of 256 threads: twice as many as the processors of an H100 hold at once.
_MOST_BLOCKS = 2112


def constant_table(values: NDArray[np.float64]) -> Any:
    """Return a Warp function of an index that gives the flat table's value there.

    The compiler folds it where the index is known to it: an unrolled loop's. ``wp.static`` of a
    loop's index would do that too, but has the kernel's code made anew in every process.
    """
    listed = ", ".join(repr(value) for value in values.ravel().tolist())

    @wp.func_native(f"const wp::float64 values[] = {{{listed}}};\nreturn values[i];")  # type: ignore[untyped-decorator]
    def entry(i: wp.int32) -> wp.float64: ...  # type: ignore[empty-body]

    return entry


@cache
def _snippets(package: str) -> dict[str, str]:
    files = [file for file in resources.files(package).iterdir() if file.name.endswith(".cu")]
    text = "\n".join(file.read_text("utf-8") for file in files)
    return dict(re.findall(r"^// snippet (\w+)\n(.*?)(?=^// snippet |\Z)", text, re.M | re.S))


def native_code(package: str, name: str, **words: object) -> str:
    """Return a snippet of a package's CUDA files, for ``warp.func_native``.

    Args:
        package: Its ``*.cu`` files hold snippets, each below a line ``// snippet NAME``; a line
            ``// include NAME`` stands for another one.
        name: Which snippet.
        words: What replaces words of it.
    """
    code = _snippets(package)[name]
    while found := re.search(r"^ *// include (\w+)\n", code, re.M):
        code = code.replace(found[0], _snippets(package)[found[1]])
    for word, value in words.items():
        code = re.sub(rf"\b{word}\b", str(value), code)
    return code


@wp.func
def repeatable(term: Any, shift: wp.float64):  # type: ignore[no-untyped-def]
    """Round a term so that its sum over threads is the same in any order of theirs.

    With a shift of 1.5 times a power of two, multiples of 2^-52 of this power are left, which sum
    without rounding up to twice the power. A shift of zero rounds nothing.
    """
    shifts = type(term)(shift)
    return (term + shifts) - shifts


def start_warp() -> None:
    """Initialise Warp; the native library reports a missing CUDA driver on file descriptor 2."""
    wp.config.log_level = wp.LOG_INFO
    wp.set_logger(WarpLog())
    told: AbstractContextManager[None] = _silent_stderr()
    with suppress(OSError):  # ctypes.util.find_library would start a linker to search for it
        ctypes.CDLL("libcuda.so.1")
        told = nullcontext()
    with told:
        wp.init()  # type: ignore[no-untyped-call]


def warp_device(name: str) -> str:
    """Return a device's name if it is here, else raise ConfigError."""
    start_warp()
    present = [device.alias for device in wp.get_devices()]
    if name not in present:
        raise ConfigError(
            f"device {name!r}: not on this machine",
            remedy=f"choose one of {', '.join(present)}; a GPU needs its NVIDIA driver",
        )
    return name


def gpus() -> list[str]:
    """Return the names of all GPUs; raise ConfigError if there is none."""
    start_warp()
    found = [device.alias for device in wp.get_devices() if device.is_cuda]
    return found or [warp_device("cuda:0")]


@contextmanager
def _silent_stderr() -> Iterator[None]:
    sys.stderr.flush()
    kept = os.dup(2)
    void = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(void, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(void)


@cache
def _other_stream(name: str, number: int) -> Any:  # noqa: ARG001 - each has its own
    return wp.Stream(name)


@dataclass(frozen=True, slots=True)
class Device:
    """A Warp device by its name, ``cpu`` or ``cuda:0``."""

    name: str

    def array(self, values: Any, kind: Any) -> Any:
        """Copy values to an array of a Warp type."""
        return wp.array(np.ascontiguousarray(values), dtype=kind, device=self.name)

    def tables(self, structure: Any, tables: Mapping[str, Any], **members: Any) -> Any:
        """Return a Warp structure with copies of tables as its arrays, and other members."""
        kinds = structure.vars
        arrays = {name: self.array(each, kinds[name].type.dtype) for name, each in tables.items()}
        return filled(structure, **arrays, **members)

    def zeroed(self, structure: Any, shape: tuple[int, ...], **others: tuple[int, ...]) -> Any:
        """Return a Warp structure whose arrays are zero, of one shape but for the named ones."""
        arrays = {
            name: self.zeros(others.get(name, shape), var.type.dtype)
            for name, var in structure.vars.items()
            if isinstance(var.type, wp.array)
        }
        return filled(structure, **arrays)

    def empty(self, shape: tuple[int, ...], kind: Any) -> Any:
        """Return an array that a kernel fills."""
        return wp.empty(shape, dtype=kind, device=self.name)

    def zeros(self, shape: int | tuple[int, ...], kind: Any) -> Any:
        """Return an array that kernels add to."""
        return wp.zeros(shape, dtype=kind, device=self.name)

    @property
    def is_gpu(self) -> bool:
        """It is a CUDA device."""
        return bool(wp.get_device(self.name).is_cuda)

    def synchronise(self) -> None:
        """Wait until everything launched is done."""
        wp.synchronize_device(self.name)

    @contextmanager
    def beside(self, *launches: Callable[[], None], number: int = 0) -> Iterator[None]:
        """Make launches before a block's own; on a GPU on the stream of a number, at once."""
        other = _other_stream(self.name, number) if self.is_gpu else None
        with wp.ScopedStream(other):
            for each in launches:
                each()
        yield
        if other is not None:
            wp.get_stream(self.name).wait_stream(other)

    def launch(
        self, kernel: Any, shape: tuple[int, ...], inputs: list[Any], outputs: list[Any]
    ) -> None:
        """Launch a kernel over a shape."""
        wp.launch(kernel, dim=shape, inputs=inputs, outputs=outputs, device=self.name)

    def record(
        self, kernel: Any, shape: tuple[int, ...], inputs: list[Any], threads: int = 0
    ) -> Any:
        """Return a launch over a shape that can be made again and again at little cost.

        With ``threads`` a block of so many has an environment. Otherwise threads take one place
        after the other: of many environments often few are wanted, and blocks that find nothing to
        do would take most of the time.
        """
        blocks: dict[str, Any] = {"block_dim": threads} if threads else {"max_blocks": _MOST_BLOCKS}
        return wp.launch(kernel, shape, inputs, device=self.name, record_cmd=True, **blocks)


def filled(structure: Any, **members: Any) -> Any:
    """Return a Warp structure with these members."""
    made = structure()
    for name, value in members.items():
        setattr(made, name, value)
    return made


def replaced(structure: Any, made: Any, **members: Any) -> Any:
    """Return a copy of a Warp structure with other values of these members."""
    return filled(structure, **{name: getattr(made, name) for name in structure.vars} | members)


def on_host(array: Any) -> NDArray[Any]:
    """Return a device array on the host, its reals as float64; on the CPU this shares memory."""
    host = array.numpy()
    return np.asarray(host, dtype=np.float64 if host.dtype.kind == "f" else host.dtype)
