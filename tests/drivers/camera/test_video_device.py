"""Finding a camera by name, serial number and path in a made-up /sys and /dev."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from drivers.camera.video_device import (
    VideoDevice,
    check_access,
    find_device,
    is_on_this_computer,
    is_url,
)
from tacauchy_rig.core.errors import DeviceError


class FakeHost:
    """A folder that looks like /sys/class/video4linux and /dev to the code under test."""

    def __init__(self, root: Path) -> None:
        self.sys_folder = root / "class"
        self.dev_folder = root / "dev"
        self._devices = root / "devices"
        self.sys_folder.mkdir()
        self.dev_folder.mkdir()

    def add(self, node: str, *, name: str, serial: str, index: int = 0) -> None:
        """Add a capture node of a USB camera."""
        usb = self._devices / serial
        (usb / "interface").mkdir(parents=True, exist_ok=True)
        (usb / "serial").write_text(f"{serial}\n")
        entry = self.sys_folder / node
        entry.mkdir()
        (entry / "name").write_text(f"{name}\n")
        (entry / "index").write_text(f"{index}\n")
        (entry / "device").symlink_to(usb / "interface")
        (self.dev_folder / node).write_bytes(b"")

    def find(self, wanted: str) -> str:
        """Return the path that ``wanted`` leads to."""
        return find_device(wanted, sys_folder=self.sys_folder, dev_folder=self.dev_folder).path


@pytest.fixture
def host(tmp_path: Path) -> FakeHost:
    """A laptop with a built-in camera and a GelSight Mini, each with two nodes."""
    host = FakeHost(tmp_path)
    host.add("video0", name="Integrated Camera: Integrated C", serial="0001")
    host.add("video1", name="Integrated Camera: Integrated C", serial="0001", index=1)
    host.add("video2", name="GelSight Mini R0B 28J2-AB12", serial="28J2AB12", index=1)
    host.add("video3", name="GelSight Mini R0B 28J2-AB12", serial="28J2AB12")
    return host


@pytest.mark.parametrize("wanted", ["gelsight mini", "28J2AB12", "GelSight"])
def test_by_name_and_serial(host: FakeHost, wanted: str) -> None:
    """The first node of the named camera is found, wherever it stands in the list."""
    assert host.find(wanted) == str(host.dev_folder / "video3")


def test_by_path(host: FakeHost) -> None:
    """A path is taken as it is and still learns the camera's name."""
    link = host.dev_folder / "by-id-video-index0"
    link.symlink_to(host.dev_folder / "video3")
    found = find_device(str(link), sys_folder=host.sys_folder, dev_folder=host.dev_folder)
    assert (found.path, found.serial) == (str(link), "28J2AB12")


def test_no_match_lists_what_is_there(host: FakeHost) -> None:
    """A name that matches nothing shows what is present."""
    with pytest.raises(DeviceError, match=r"no camera matches 'DIGIT'.*28J2AB12"):
        host.find("DIGIT")


@pytest.mark.parametrize("wanted", ["", "i"])
def test_several_matches_are_refused(host: FakeHost, wanted: str) -> None:
    """Two cameras that match are never chosen between by order."""
    with pytest.raises(DeviceError, match=r"2 cameras match|no camera matches ''"):
        host.find(wanted)


def test_missing_path(host: FakeHost) -> None:
    """A path that is not there is named."""
    with pytest.raises(DeviceError, match="/dev/video99 does not exist"):
        host.find("/dev/video99")


def test_no_permission(host: FakeHost) -> None:
    """A camera that this user may not open names the group to join."""
    node = host.dev_folder / "video3"
    node.chmod(0)
    user = os.geteuid()
    try:
        if user == 0:
            os.seteuid(65534)
        with pytest.raises(DeviceError, match="no permission") as caught:
            check_access(VideoDevice(path=str(node), name="GelSight Mini", serial="28J2AB12"))
    finally:
        os.seteuid(user)
    assert "video" in caught.value.remedy


def test_in_use_names_the_program(host: FakeHost) -> None:
    """A camera that another program holds is refused with that program's name."""
    with (host.dev_folder / "video3").open("rb") as node:
        program = subprocess.Popen(["sleep", "30"], stdin=node)
    try:
        with pytest.raises(DeviceError, match=rf"in use by sleep \(pid {program.pid}\)"):
            host.find("28J2AB12")
    finally:
        program.kill()
        program.wait()


def test_urls_are_told_from_names() -> None:
    """An address is an address, a name is a name."""
    assert is_url("http://127.0.0.1:8080/stream")
    assert not is_url("/dev/video0")
    assert not is_url("GelSight Mini")


@pytest.mark.parametrize(
    ("url", "local"),
    [
        ("http://127.0.0.1:8080/a.mjpg", True),
        ("http://localhost/a", True),
        ("http://[::1]:80/a", True),
        ("http://192.168.0.20/a", False),
    ],
)
def test_streams_of_this_computer_are_known(url: str, local: bool) -> None:
    """An emulated camera's address is told from one on the network."""
    assert is_on_this_computer(url) is local
