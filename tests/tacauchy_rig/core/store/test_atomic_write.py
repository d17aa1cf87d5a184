"""Disks: room is known before the arm moves, and what is said when one takes nothing."""

import errno
import os
import shutil
from collections import namedtuple
from pathlib import Path
from typing import Any, Never

import pytest

from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.store.atomic_write import free_bytes, write_atomically, write_error
from tacauchy_rig.core.store.free_space import (
    ARM_MESSAGE_BYTES,
    FORCE_MESSAGE_BYTES,
    check_free_space,
    estimate_session,
)
from tacauchy_rig.core.store.recording.mcap_writer import RecordingWriter


def test_a_disk_that_became_read_only_is_called_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Such a disk refuses to remove a file too, even one that is not there."""

    def refuse(path: Path, *_: object, **__: object) -> Never:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))

    monkeypatch.setattr(Path, "open", refuse)
    monkeypatch.setattr(Path, "unlink", refuse)
    with pytest.raises(RecordError, match=r"result\.json: its disk is read-only") as caught:
        write_atomically(tmp_path / "result.json", b"{}")
    assert "mount it for writing" in caught.value.remedy


@pytest.mark.parametrize(
    ("path", "setting"),
    [("/home/a/.cache/tacauchy-rig/meshes", "XDG_CACHE_HOME"), ("/runs/r", "run.output_directory")],
)
def test_the_setting_that_names_another_place_is_told(path: str, setting: str) -> None:
    """What is kept between runs lies elsewhere than the runs."""
    error = write_error(Path(path), PermissionError(errno.EACCES, "Permission denied"))
    assert setting in error.remedy


Usage = namedtuple("Usage", ("total", "used", "free"))


def test_the_estimate_follows_the_configuration() -> None:
    """Larger images and more trials need more; the default session is what its parts add up to."""
    default = estimate_session(load_config().config)
    large = estimate_session(
        load_config(overrides=["camera.width=3280", "camera.height=2464"]).config
    )
    more = ", ".join('"1 N"' for _ in range(12))
    longer = estimate_session(load_config(overrides=[f"protocol.force_targets=[{more}]"]).config)
    assert default.trial_s == pytest.approx(2 + 0.5 + 3 + 8 + 2 / 0.3 + 15 + 1.2 + 3)
    images = 18.75 * 640 * 480 * 0.25
    assert default.rate_bytes_s == pytest.approx(images + 500 * 350 + 100 * 280)
    assert default.total_bytes == pytest.approx(7 * default.trial_s * default.rate_bytes_s + 200e6)
    assert large.rate_bytes_s > 20 * default.rate_bytes_s
    assert longer.total_bytes - 200e6 == pytest.approx((default.total_bytes - 200e6) * 13 / 7)


def test_message_sizes_are_measured(tmp_path: Path, samples: Any) -> None:
    """The sizes that the estimate uses are not below those of a real file."""
    sizes = []
    for kind in ("force", "arm"):
        path = tmp_path / f"{kind}.mcap"
        with RecordingWriter(path, metadata={}) as writer:
            empty = path.stat().st_size
            for number in range(1000):
                writer.write([getattr(samples, kind)(number)])
        sizes.append((path.stat().st_size - empty) / 1000)
    assert 0.7 * FORCE_MESSAGE_BYTES < sizes[0] <= FORCE_MESSAGE_BYTES
    assert 0.7 * ARM_MESSAGE_BYTES < sizes[1] <= ARM_MESSAGE_BYTES


def test_a_disk_that_is_too_small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The message says what is free, what is needed, and for what."""
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: Usage(10**9, 10**9 - 10**8, 10**8))
    config = load_config(overrides=["camera.width=3280", "camera.height=2464"]).config
    with pytest.raises(RecordError) as caught:
        check_free_space(tmp_path / "runs", config)
    assert "runs: 100.0 MB free, but this session may record 10." in caught.value.message
    assert "6 trials of up to 39 s" in caught.value.message
    assert "3280x2464 images at 18.75 Hz" in caught.value.message
    assert "run.output_directory" in caught.value.remedy


def test_a_disk_with_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With room for it the estimate is returned, also for a folder that does not exist yet."""
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: Usage(10**12, 0, 10**12))
    folder = tmp_path / "not" / "yet"
    assert check_free_space(folder, load_config().config).total_bytes > 200e6
    assert free_bytes(folder) == 10**12
    assert not folder.exists()
