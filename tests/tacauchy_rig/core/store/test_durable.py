"""What is said when a disk takes nothing."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Never

import pytest

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.store.durable import write_atomically, write_error


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
