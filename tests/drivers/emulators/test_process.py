"""Emulators ask to be run when they are due, and do without where they may not."""

import os
import sys

import pytest

from drivers.emulators.faults import Device
from drivers.emulators.process import DeviceSettings, command_line, keep_time, run_device
from tacauchy_rig.core.config.load import load_config


@pytest.mark.parametrize("mostly_sleeps", [True, False])
def test_a_refused_priority_is_no_error(monkeypatch, mostly_sleeps):
    """A user without the right to a higher priority emulates all the same."""
    asked = []

    def refuse(*arguments):
        asked.append(arguments)
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(os, "nice", refuse)
    keep_time(mostly_sleeps=mostly_sleeps)
    assert len(asked) == 1
    assert asked[0][0] == (0 if mostly_sleeps else -10)


def test_a_folder_that_cannot_be_made_is_refused_in_words(monkeypatch, capsys, tmp_path):
    """Whatever the device: exit status 2, its name, the reason and a remedy."""
    file = tmp_path / "file"
    file.touch()
    command = command_line(
        "any", DeviceSettings(folder=file / "folder", config=load_config().config)
    )
    monkeypatch.setattr(sys, "argv", command[2:])
    assert run_device(Device.CAMERA, lambda *_: None) == 2
    told = capsys.readouterr().err
    assert told.startswith("emulated camera: Not a directory")
    assert f"see that {file / 'folder'} can be created" in told
