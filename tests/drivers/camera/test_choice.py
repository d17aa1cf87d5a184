"""Which camera is meant: by name, serial number, link or path, in trees as the kernel makes them.

Names, serial numbers and ports are those of real computers: a GelSight Mini and a DIGIT as their
users list them, two Logitech C270 with one serial number, a depth camera with several interfaces.
"""

import os
import subprocess
from pathlib import Path

import pytest

from drivers.camera import choice as devices
from tacauchy_rig.core.errors import DeviceError

HOST = "pci0000:00/0000:00:14.0/usb1"


class FakeHost:
    """Folders that look like /sys/class/video4linux and /dev to the code under test."""

    def __init__(self, root: Path) -> None:
        self.sys_folder = root / "class"
        self.dev_folder = root / "dev"
        self._devices = root / "devices" / HOST
        self.sys_folder.mkdir()
        (self.dev_folder / "v4l/by-path").mkdir(parents=True)
        (self.dev_folder / "v4l/by-id").mkdir()

    def add(
        self,
        node: str,
        *,
        name: str,
        serial: str,
        port: str,
        index: int = 0,
        interface: str = "1.0",
        by_id: str = "",
    ) -> None:
        """Add a node of a USB camera, and the links that udev makes for it."""
        usb = self._devices / port.partition(".")[0] / port
        inside = usb / f"{port}:{interface}" / "video4linux" / node
        inside.mkdir(parents=True)
        (usb / "serial").write_text(f"{serial}\n")
        (inside / "name").write_text(f"{name}\n")
        (inside / "index").write_text(f"{index}\n")
        (inside / "device").symlink_to(usb / f"{port}:{interface}")
        (self.sys_folder / node).symlink_to(inside)
        (self.dev_folder / node).write_bytes(b"")
        hub = port.partition("-")[2]
        for bus in ("usb", "usbv2"):  # systemd 255 and later also write the version
            link = f"pci-0000:00:14.0-{bus}-0:{hub}:{interface}-video-index{index}"
            (self.dev_folder / "v4l/by-path" / link).symlink_to(self.dev_folder / node)
        if by_id:
            link_by_id = self.dev_folder / "v4l/by-id" / f"usb-{by_id}-video-index{index}"
            link_by_id.unlink(missing_ok=True)  # of equal names the last one stays
            link_by_id.symlink_to(self.dev_folder / node)

    def find(self, wanted: str) -> str:
        """Return the path that ``wanted`` leads to."""
        return devices.find_device(
            wanted, sys_folder=self.sys_folder, dev_folder=self.dev_folder
        ).path

    def by_path(self, port: str, interface: str = "1.0") -> str:
        """Return udev's link to the first node at a port."""
        link = f"pci-0000:00:14.0-usb-0:{port}:{interface}-video-index0"
        return str(self.dev_folder / "v4l/by-path" / link)


@pytest.fixture
def host(tmp_path: Path) -> FakeHost:
    """A computer with a built-in camera, a GelSight Mini and a DIGIT."""
    host = FakeHost(tmp_path)
    built_in = {"name": "Integrated Camera: Integrated C", "serial": "0001", "port": "1-8"}
    host.add("video0", **built_in)
    host.add("video1", **built_in, index=1)
    mini = {"name": "GelSight Mini R0B 2D8Y-69GR: Ge", "serial": "2D8Y69GR", "port": "1-1.2"}
    host.add("video2", **mini, index=1)
    host.add("video3", **mini)
    digit = {"name": "DIGIT: DIGIT", "serial": "D20576", "port": "1-1.2.3"}
    host.add("video4", **digit, by_id="Facebook_DIGIT_D20576")
    return host


@pytest.mark.parametrize("wanted", ["gelsight mini", "2D8Y69GR", "GelSight"])
def test_by_name_and_serial(host: FakeHost, wanted: str) -> None:
    """The first node of the named camera is found, wherever it stands in the list."""
    assert host.find(wanted) == str(host.dev_folder / "video3")


def test_by_link(host: FakeHost) -> None:
    """A link below /dev/v4l is taken as it is and still learns the camera's name."""
    link = host.dev_folder / "v4l/by-id/usb-Facebook_DIGIT_D20576-video-index0"
    found = devices.find_device(str(link), sys_folder=host.sys_folder, dev_folder=host.dev_folder)
    assert (found.path, found.serial, found.name) == (str(link), "D20576", "DIGIT: DIGIT")


def test_equal_serial_numbers_are_told_apart_by_their_ports(tmp_path: Path) -> None:
    """Two C270 share a serial number, and so one link by it: the ports are listed, and lead there.

    The links with "usbv2" name the same ports again and are not what an operator is told.
    """
    host = FakeHost(tmp_path)
    camera = {"name": "C270 HD WEBCAM", "serial": "200901010001", "by_id": "046d_0825_200901010001"}
    host.add("video0", port="1-1.2.3", **camera)
    host.add("video2", port="1-1.2.4", **camera)
    with pytest.raises(DeviceError, match="2 cameras match '200901010001'") as caught:
        host.find("200901010001")
    assert all(host.by_path(port) in caught.value.message for port in ("1.2.3", "1.2.4"))
    assert "by-path" in caught.value.remedy
    for port, node in (("1.2.3", "video0"), ("1.2.4", "video2")):
        assert os.path.realpath(host.find(host.by_path(port))) == str(host.dev_folder / node)


def test_interfaces_of_one_camera_are_told_apart(tmp_path: Path) -> None:
    """A depth camera has several first nodes at one port; by-path names the interface too."""
    host = FakeHost(tmp_path)
    camera = {"name": "Intel(R) RealSense(TM) Depth Ca", "serial": "827312070790", "port": "1-3"}
    host.add("video0", **camera)
    host.add("video4", **camera, interface="1.3")
    with pytest.raises(DeviceError, match="2 cameras match"):
        host.find("RealSense")
    assert os.path.realpath(host.find(host.by_path("3", "1.3"))).endswith("video4")


def test_no_match_lists_what_is_there(host: FakeHost) -> None:
    """A name that matches nothing shows what is present."""
    with pytest.raises(DeviceError, match=r"no camera matches '9DTact'.*2D8Y69GR"):
        host.find("9DTact")


@pytest.mark.parametrize("wanted", ["", "i"])
def test_several_matches_are_refused(host: FakeHost, wanted: str) -> None:
    """Two cameras that match are never chosen between by order."""
    with pytest.raises(DeviceError, match=r"3 cameras match|no camera matches ''"):
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
            devices.check_access(
                devices.VideoDevice(path=str(node), name="GelSight Mini", serial="2D8Y69GR")
            )
    finally:
        os.seteuid(user)
    assert "video" in caught.value.remedy


def test_in_use_names_the_program(host: FakeHost) -> None:
    """A camera that another program holds is refused with that program's name."""
    with (host.dev_folder / "video3").open("rb") as node:
        program = subprocess.Popen(["sleep", "30"], stdin=node)
    try:
        with pytest.raises(DeviceError, match=rf"in use by sleep \(pid {program.pid}\)"):
            host.find("2D8Y69GR")
    finally:
        program.kill()
        program.wait()


@pytest.mark.parametrize(
    ("device", "url", "local"),
    [
        ("http://127.0.0.1:8080/a.mjpg", True, True),
        ("http://localhost/a", True, True),
        ("http://[::1]:80/a", True, True),
        ("http://192.168.0.20/a", True, False),
        ("/dev/video0", False, False),
        ("GelSight Mini", False, False),
    ],
)
def test_streams_of_this_computer_are_known(device: str, url: bool, local: bool) -> None:
    """An address is told from a name, an emulated camera's from one on the network."""
    assert (devices.is_url(device), devices.is_on_this_computer(device)) == (url, local)
