"""Driver of a one-axis load cell that sends `counter,counts` lines on a serial port."""

import threading
import time

import serial

from drivers.interfaces import Arm, DeviceIdentity, StreamHealth
from drivers.stream_buffer_and_repeats import StreamBuffer
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.errors import DeviceError
from tacauchy_rig.core.run import ForceSample


class MyCell:
    """Obeys ``drivers.interfaces.ForceTorqueSensor``."""

    def __init__(self, config: RigConfig, _arm: Arm | None = None) -> None:
        # _arm carries the cell; None in doctor
        self._settings = config.force_sensor
        self._newtons = float(self._settings.options["newtons_per_count"])
        self._buffer = StreamBuffer[ForceSample](capacity=int(600 * self._settings.rate))
        self._stopping = threading.Event()
        self._port: serial.Serial | None = None
        self._thread: threading.Thread | None = None
        self._counter: int | None = None
        self._lost = self._corrupt = 0

    def connect(self) -> DeviceIdentity:
        """Open the port and wait for the first sample."""
        path = self._settings.port
        try:
            port = serial.Serial(path, self._settings.baud_rate, timeout=0.05, exclusive=True)
        except OSError as error:
            raise DeviceError(
                f"force sensor: {path} does not open: {error}",
                remedy="check cable and group dialout; end other programs that use the port",
            ) from error
        self._port = port
        port.readline()  # the first line may have begun before the port was open
        self._thread = threading.Thread(target=self._read, args=(port,), daemon=True)
        self._thread.start()
        if not self._buffer.wait_for_first(timeout_s=self._settings.connect_timeout):
            self.close()
            raise DeviceError(
                f"force sensor: no sample from {path} in {self._settings.connect_timeout:g} s",
                remedy="check the cell's power and force_sensor.baud_rate",
            )
        return DeviceIdentity(
            driver="my-cell",
            address=path,
            model="one-axis cell, 24 bits",
            serial="unknown",
            simulated=False,
            settings={"newtons_per_count": f"{self._newtons:g}"},
        )

    def drain(self) -> list[ForceSample]:
        """Return the samples that are new."""
        return self._buffer.drain()

    def health(self) -> StreamHealth:
        """Return the stream's rate and counts."""
        return self._buffer.health(lost_count=self._lost, corrupt_count=self._corrupt)

    def close(self) -> None:
        """End the thread and close the port."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join(1.0)
        if self._port is not None:
            self._port.close()

    def _read(self, port: serial.Serial) -> None:
        line = b""
        try:
            while not self._stopping.is_set():
                line += port.readline()  # returns a part of a line after the timeout
                if line.endswith(b"\n"):
                    self._accept(line, time.monotonic_ns())
                    line = b""
        except (OSError, TypeError) as error:  # pyserial raises TypeError if the port closes
            self._buffer.fail(
                DeviceError(f"force sensor: the port is gone ({error})", remedy="check the cable")
            )

    def _accept(self, line: bytes, stamp_ns: int) -> None:
        try:
            counter, counts = map(int, line.split(b","))
        except ValueError:
            self._corrupt += 1
            return
        if self._counter is not None:
            self._lost += max(0, counter - self._counter - 1)
        self._counter = counter
        force_n = counts * self._newtons
        sample = ForceSample(
            stamp_ns=stamp_ns, counter=counter, wrench=(0.0, 0.0, force_n, 0.0, 0.0, 0.0)
        )
        self._buffer.push(sample, stamp_ns=stamp_ns, fingerprint=counts)
