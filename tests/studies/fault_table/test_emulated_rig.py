"""The rig of a fault case: its configuration, and messages without its own places."""

from __future__ import annotations

import sys
from pathlib import Path

from tacauchy_rig.core.config.load import load_config
from tests.studies.fault_table.emulated_rig import EmulatedRig, write_case_config


def test_a_case_is_one_press_on_devices_that_count_as_real(tmp_path: Path) -> None:
    """Emulated devices at addresses of the case, and one short press."""
    config = load_config(write_case_config(tmp_path, host="127.0.0.9", camera_port=9090)).config
    assert config.robot.host == "127.0.0.9"
    assert ":9090/" in config.camera.device
    assert str(tmp_path) in config.force_sensor.port
    assert config.protocol.force_targets == (2.0,)


def test_messages_of_two_cases_can_be_compared(tmp_path: Path) -> None:
    """Addresses and folders are the case's alone and are left out."""
    rig = EmulatedRig(tmp_path)
    seen = f"{tmp_path}/runs/2026/trial, {rig.rig_toml}, {sys.executable}"
    text = f"robot {rig.config.robot.host}: see {seen}"
    python = Path(sys.executable).name
    assert rig.without_places(text) == f"robot: see RUN/trial, WORK/rig.toml, {python}"
