"""A tar file for WebDataset: one sample a press, its images and arrays under one key.

``rest`` is the newest image without contact, ``pressed`` the middle one of the dwell.
"""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from tacauchy_rig.app.exporting.episode import Episode
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import ImageFrame
from tacauchy_rig.core.store.run_store import RunStore


def write_webdataset(presses: Iterable[Episode], out: Path, _store: RunStore | None) -> None:
    """Write presses into ``presses-000000.tar``."""
    with tarfile.open(out / "presses-000000.tar", "w") as tar:
        for episode in presses:
            for ending, content in _members(episode):
                member = tarfile.TarInfo(f"{episode.outputs['run']}-{episode.name}.{ending}")
                member.size = len(content)
                tar.addfile(member, io.BytesIO(content))


def _members(episode: Episode) -> Iterator[tuple[str, bytes]]:
    """Yield what makes the sample of a press, each with its ending."""
    for name, window, share in (("rest", "reference", 1.0), ("pressed", "dwell", 0.5)):
        frame = _image(episode, window, share)
        yield f"{name}.{frame.kind.replace('jpeg', 'jpg')}", frame.jpeg
    yield "json", json.dumps(dict(episode.outputs), allow_nan=False).encode()
    arrays = {"wrench_n_nm": episode.tared.within(episode.windows["dwell"]).value}
    for name, array in {**arrays, **episode.fields()}.items():
        file = io.BytesIO()
        np.save(file, array, allow_pickle=False)
        yield f"{name}.npy", file.getvalue()


def _image(episode: Episode, window: str, share: float) -> ImageFrame:
    """Return the image at a share of a window.

    Raises:
        RecordError: There is none.
    """
    start_ns, end_ns = episode.windows.get(window, (1, 0))
    inside = np.flatnonzero((episode.stamps_ns >= start_ns) & (episode.stamps_ns <= end_ns))
    if not len(inside):
        raise RecordError(
            f"{episode.name}: has no image in its {window}",
            remedy="leave the trial out of the run, or export it --to csv",
        )
    wanted = inside[round(share * (len(inside) - 1))]
    return next(f for n, f in enumerate(episode.frames()) if n == wanted)
