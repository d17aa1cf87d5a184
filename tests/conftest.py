"""Options and skips that all tests share."""

import gc
import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from typing import Any

import pytest
from absl import logging as absl_logging
from hypothesis import HealthCheck, settings

# The same examples in every run, and no limit on how long one takes: that is the machine's matter.
settings.register_profile(
    "rig", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("rig")

# absl's log would else hold the file that pytest captures into, and close it with its handler as
# soon as uvicorn sets up logging.
absl_logging.get_absl_handler().python_handler.stream = sys.__stderr__

for _variable in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

BROWSER_OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """A real browser; skips where there is none."""
    path = shutil.which("chromium") or shutil.which("chromium-browser")
    if path is None:
        pytest.skip("no chromium: `apt-get install chromium`")
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(BROWSER_OPTIONS))
        yield browser
        browser.close()


def pytest_collection(session: pytest.Session) -> None:
    """Let one of two workers begin with the last modules: in a fresh clone each compiles half."""
    root, is_whole = session.config.rootpath, session.config.args == ["tests"]
    if is_whole and os.environ.get("PYTEST_XDIST_WORKER") == "gw1":
        for path in sorted(root.glob("tests/**/test_*.py"), reverse=True):
            with suppress(Exception, pytest.skip.Exception):  # the collection itself will tell
                import_module(".".join(path.relative_to(root).with_suffix("").parts))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip what this machine cannot run, and say so; begin with what takes longest."""
    # Their runs take a minute and serve a whole module: begun last, they would be made by every
    # worker that takes one of their tests over.
    items.sort(key=lambda item: item.path.name not in ("test_whole_loop.py", "test_reduced.py"))
    no_gpu = pytest.mark.skip(reason="no CUDA device")
    cuda = _has_cuda() if any("gpu" in item.keywords for item in items) else False
    for item in items:
        if "gpu" in item.keywords and not cuda:
            item.add_marker(no_gpu)


def pytest_collection_finish() -> None:
    """Let the garbage collector pass over what stays to the end, modules and tests, and rest."""
    gc.freeze()
    gc.set_threshold(20_000, 20, 50)


def _has_cuda() -> bool:
    import warp as wp  # noqa: PLC0415 - a second of start-up, for GPU tests only

    wp.config.quiet = True
    return bool(wp.is_cuda_available())
