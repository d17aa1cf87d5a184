"""The driver of the how-to page of force sensors is found, and conforms."""

import itertools
import os
import pty
import re
import shutil
import threading
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.registry import Kind, load

PAGE = Path(__file__).parents[1] / "docs" / "how-to" / "add-a-force-sensor.md"
RATE_HZ = 80.0
DRIVER = Path(__file__).parent / "outside_package" / "press_lab" / "cell.py"
(CHECK,) = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
PROJECT, RIG = re.findall(r"```toml\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)


class Cell:
    """A cell at the other end of a pseudo-terminal, which sends what the page says."""

    def __init__(self) -> None:
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._send)
        self._thread.start()

    def _send(self) -> None:
        begun_s = time.monotonic()
        for number in itertools.count(1):
            if self._stopping.wait(max(0.0, begun_s + number / RATE_HZ - time.monotonic())):
                return
            os.write(self._master, f"{number},{(7919 * number) % 2000 - 1000}\r\n".encode())

    def close(self) -> None:
        """Fall silent and let go of both ends."""
        self._stopping.set()
        self._thread.join()
        for end in (self._master, self._slave):
            os.close(end)


@pytest.fixture
def cell() -> Iterator[Cell]:
    """A cell that sends."""
    cell = Cell()
    yield cell
    cell.close()


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the package installed, as pip would, without a network."""
    shutil.copy(DRIVER, tmp_path / "my_cell.py")
    metadata = tmp_path / "my_cell-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: my-cell\nVersion: 1.0\n")
    (point,) = re.findall(r'^my-cell = "(.*)"$', PROJECT, re.M)
    text = f"[tacauchy_rig.force_sensors]\nmy-cell = {point}\n"
    (metadata / "entry_points.txt").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def configured(place: Path, port: str) -> RigConfig:
    """Return the page's configuration, with another port."""
    (given,) = re.findall(r'^port = "(.*)"$', RIG, re.M)
    (place / "rig.toml").write_text(RIG.replace(given, port), "utf-8")
    return load_config(place / "rig.toml").config


def test_it_keeps_what_every_force_sensor_promises(
    place: Path, cell: Cell, capsys: pytest.CaptureFixture[str]
) -> None:
    """The page's own check, driver and configuration."""
    configured(place, cell.port)
    exec(compile(CHECK, str(PAGE), "exec"), {})  # noqa: S102 - our own page
    assert capsys.readouterr().out == "the driver conforms\n"


def test_it_is_found_by_its_name_and_reads_newtons(place: Path, cell: Cell) -> None:
    """The registry has it; its option scales counts, and both other axes are zero."""
    config = configured(place, cell.port)
    sensor = load(Kind.FORCE_SENSOR, config.force_sensor.driver)(config, None)
    sensor.connect()
    (sample, *_) = sensor.drain()
    sensor.close()
    counts = (7919 * sample.counter) % 2000 - 1000
    assert sample.wrench[:3] == pytest.approx((0.0, 0.0, 2.1e-5 * counts))
    assert sample.wrench[3:] == (0.0, 0.0, 0.0)


def test_a_port_that_is_not_there_is_named(place: Path) -> None:
    """With what to do."""
    config = configured(place, str(place / "ttyNONE"))
    with pytest.raises(DeviceError, match="ttyNONE does not open") as refused:
        load(Kind.FORCE_SENSOR, "my-cell")(config, None).connect()
    assert "dialout" in refused.value.remedy
