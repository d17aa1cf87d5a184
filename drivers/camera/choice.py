"""Which camera is meant by ``camera.device`` where several are connected."""

import os
import socket
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import urlsplit

from drivers.device_holders import device_holders
from tacauchy_rig.core.errors import DeviceError

_PORTS = {"http": 80, "https": 443, "rtsp": 554}


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoDevice:
    """A capture device that the kernel lists; ``serial`` may be empty.

    ``links`` are the names that udev gives it below ``/dev/v4l``, the one of its USB port first.
    """

    path: str
    name: str = ""
    serial: str = ""
    links: tuple[str, ...] = ()

    def __str__(self) -> str:
        port = f" ({self.links[0]})" if self.links else ""
        return f"{self.name!r} serial {self.serial or 'none'} at {self.path}{port}"


def is_url(device: str) -> bool:
    """Return whether ``device`` is the address of a stream."""
    return "://" in device


def is_on_this_computer(url: str) -> bool:
    """Return whether a stream comes from this computer's loopback, as an emulated camera's does."""
    host = urlsplit(url).hostname or ""
    return host == "localhost" or host.startswith("127.") or host == "::1"


def video_devices(
    *, sys_folder: Path = Path("/sys/class/video4linux"), dev_folder: Path = Path("/dev")
) -> list[VideoDevice]:
    """Return the first node (``video-index0``) of every camera present."""
    found = []
    for entry in sorted(sys_folder.glob("video*")):
        if _content(entry / "index") not in ("", "0"):
            continue
        # device is the USB interface; the USB device above it holds the serial number
        serial = _content((entry / "device").resolve().parent / "serial")
        node = dev_folder / entry.name
        kinds = (dev_folder / "v4l" / kind for kind in ("by-path", "by-id"))
        links = sorted(str(link) for kind in kinds for link in kind.glob("*"))
        links = [link for link in links if os.path.realpath(link) == os.path.realpath(node)]
        # By port before by serial number; newer systemds name a port twice.
        links.sort(key=lambda link: ("/by-id/" in link, "-usbv" in link))
        name = _content(entry / "name")
        found.append(VideoDevice(path=str(node), name=name, serial=serial, links=tuple(links)))
    return found


def find_device(
    wanted: str,
    *,
    sys_folder: Path = Path("/sys/class/video4linux"),
    dev_folder: Path = Path("/dev"),
) -> VideoDevice:
    """Return the one camera that ``wanted`` names, and check that this user may open it.

    Args:
        wanted: Path of a device file or of a link to it, a serial number, or a part of the
            camera's name.

    Raises:
        DeviceError: None or several match, no permission, or in use.
    """
    present = video_devices(sys_folder=sys_folder, dev_folder=dev_folder)
    listed = "; ".join(map(str, present))
    if wanted.startswith("/"):
        device = _by_path(wanted, present)
    else:
        matches = [d for d in present if d.serial and d.serial == wanted]
        matches = matches or [d for d in present if wanted.casefold() in d.name.casefold()]
        if not wanted or len(matches) != 1:
            several = f"{len(matches)} cameras match" if matches else "no camera matches"
            remedy = "set camera.device to the serial number or the full name; check the USB cable"
            if len(matches) > 1:
                remedy = "set camera.device to the path below /dev/v4l/by-path of the one that is "
                remedy += "meant: it names the USB port, which two cameras never share"
            raise DeviceError(
                f"camera: {several} {wanted!r}; present: {listed or 'none'}", remedy=remedy
            )
        device = matches[0]
    check_access(device)
    return device


def probe_url(url: str, *, timeout_s: float) -> None:
    """See whether anything accepts connections where ``url`` points."""
    parts = urlsplit(url)
    address = (parts.hostname or "", parts.port or _PORTS.get(parts.scheme, 80))
    try:
        socket.create_connection(address, timeout=timeout_s).close()
    except OSError as error:
        raise DeviceError(
            f"camera: nothing answers at {url} ({error})",
            remedy="check that the stream is running and camera.device is its address",
        ) from error


def _by_path(path: str, present: list[VideoDevice]) -> VideoDevice:
    if not Path(path).exists():
        listed = ", ".join(device.path for device in present)
        raise DeviceError(
            f"camera: {path} does not exist",
            remedy=f"check the USB cable; cameras present now: {listed or 'none'}",
        )
    real = os.path.realpath(path)
    for device in present:
        if os.path.realpath(device.path) == real:
            return replace(device, path=path)
    return VideoDevice(path=path)


def check_access(device: VideoDevice) -> None:
    """See whether this user may open the camera and nobody else holds it."""
    if not os.access(device.path, os.R_OK | os.W_OK, effective_ids=True):
        raise DeviceError(
            f"camera: no permission to open {device.path}",
            remedy="sudo usermod -aG video $USER, then log out and in again",
        )
    holders = device_holders(device.path)
    if holders:
        raise DeviceError(
            f"camera: {device.path} is in use by {', '.join(holders)}",
            remedy=f"end that program; `fuser -v {device.path}` names it",
        )


def _content(path: Path) -> str:
    try:
        return path.read_text("utf-8", errors="replace").strip()
    except OSError:
        return ""
