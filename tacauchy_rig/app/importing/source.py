"""The folder that is imported: files are found in it, bounded, hashed, and nowhere else."""

from __future__ import annotations

import io
import os
import stat
from pathlib import Path

from PIL import Image, UnidentifiedImageError

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.store.durable import read_error
from tacauchy_rig.core.store.seals import bytes_sha256, file_sha256

MIB = 2**20
IMAGE_BYTES = 64 * MIB
"""Of an image's file: 40 megapixels as PNG, noise and all, are less."""
IMAGE_PIXELS = 40_000_000
"""More than any tactile camera has; a file of a few kilobytes can claim a thousand times that."""
TABLE_BYTES = 256 * MIB
"""Of a table or a log: a kilohertz for half an hour, seven numbers a line."""
LARGE_BYTES = 8192 * MIB
"""Of a bag, a video or an archive, which is read piece by piece."""
_KINDS = ("JPEG", "PNG")
_MODES = ("RGB", "L")


class Source:
    """A folder of somebody else's files.

    Attributes:
        root: Where it lies, links resolved.
        hashes: SHA-256 of what was read of it, by name.
    """

    def __init__(self, root: Path) -> None:
        if not root.is_dir():
            raise RecordError(
                f"{root}: no such folder to import", remedy="give the folder that import.toml is in"
            )
        self.root = root.resolve()
        self.hashes: dict[str, str] = {}

    def path(self, name: str, *, field: str, most_bytes: int) -> Path:
        """Return where a file lies, its hash noted.

        Args:
            name: Relative to the folder, as the source says it.
            field: Where it says so, for messages.
            most_bytes: That it may have.

        Raises:
            RecordError: It leads out of the folder, is missing, no plain file, empty or too large.
        """
        path = self._inside(name, field)
        try:
            found = path.lstat()
        except OSError as error:
            raise RecordError(
                f"{field}: {name!r} cannot be found in {self.root}: {error.strerror}",
                remedy="correct the name, or put the file there",
            ) from error
        if not stat.S_ISREG(found.st_mode):
            raise RecordError(f"{field}: {name!r} is no plain file", remedy="name a file")
        if not 0 < found.st_size <= most_bytes:
            raise RecordError(
                f"{field}: {name!r} has {found.st_size} bytes; 1 to {most_bytes} are read",
                remedy="look at the file: it is empty, or of another kind than is said",
            )
        if name not in self.hashes:
            self.hashes[name] = file_sha256(path, what="a file of the source")
        return path

    def folder(self, name: str, *, field: str) -> Path:
        """Return where a folder of the source lies, itself included.

        Raises:
            RecordError: It leads out of the source, or is no folder.
        """
        path = self._inside(name, field)
        if not path.is_dir():
            raise RecordError(
                f"{field}: {name!r} is no folder of {self.root}", remedy="correct the name"
            )
        return path

    def read(self, name: str, *, field: str, most_bytes: int) -> bytes:
        """Return a file's bytes; what is raised is as for ``path``."""
        path = self.path(name, field=field, most_bytes=most_bytes)
        try:
            return path.read_bytes()
        except OSError as error:
            raise read_error(path, error, what="a file of the source") from error

    def _inside(self, name: str, field: str) -> Path:
        """Return the path of a name within the folder; links out of it are resolved and refused."""
        remedy = f"import reads nothing outside of {self.root}: put the file there"
        if not name or "\0" in name or Path(name).is_absolute():
            raise RecordError(f"{field}: {name!r} is no name within the folder", remedy=remedy)
        path = Path(os.path.realpath(self.root / name))
        if not path.is_relative_to(self.root):
            raise RecordError(f"{field}: {name!r} leads out of the folder", remedy=remedy)
        return path


def image_size(data: bytes, *, name: str) -> tuple[int, int]:
    """Return width and height [px] of a whole JPEG or PNG in colour or grey.

    Raises:
        RecordError: It is another kind, damaged, or larger than any camera's.
    """
    try:
        with Image.open(io.BytesIO(data), formats=_KINDS) as image:
            width, height = image.size
            if width * height > IMAGE_PIXELS:
                raise RecordError(
                    f"image {name}: says that it is {width} x {height} px; at most {IMAGE_PIXELS} "
                    "pixels are read",
                    remedy="scale it down, or leave it out",
                )
            if image.mode not in _MODES:
                raise RecordError(
                    f"image {name}: of the kind {image.mode}; 8 bits of colour or grey are read",
                    remedy="convert it to RGB with 8 bits a channel",
                )
            image.load()
    except RecordError:
        raise
    except (UnidentifiedImageError, Image.DecompressionBombError, OSError, ValueError) as error:
        raise RecordError(
            f"image {name}: no whole JPEG or PNG ({len(data)} bytes): {error}",
            remedy="replace the file, or leave its row out",
        ) from error
    except SyntaxError as error:  # what Pillow says of a broken PNG
        raise RecordError(
            f"image {name}: damaged: {error}", remedy="replace the file, or leave its row out"
        ) from error
    return width, height


def content_hash(data: bytes) -> str:
    """Return the SHA-256 of a member of an archive."""
    return bytes_sha256(data)
