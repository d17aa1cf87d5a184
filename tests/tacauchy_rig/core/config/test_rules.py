"""Limits that no rig could honour: each rule is broken once and its message read."""

from __future__ import annotations

import pytest

from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.errors import ConfigError

BROKEN = [
    (
        ['limits.soft_force="4.75 N"'],
        (
            "limits.soft_force: 4.75 N does not clear the highest target 4.7332 N plus its "
            "tolerance 0.03 N; raise soft_force or lower the targets"
        ),
    ),
    (
        ['limits.hard_force="6 N"'],
        "limits.hard_force: 6 N is not above soft_force 6 N; raise hard_force",
    ),
    (
        ['camera.device="http://127.0.0.1:188119/s"'],
        (
            'camera.device: "http://127.0.0.1:188119/s": Port out of range 0-65535; give a port '
            "from 1 to 65535"
        ),
    ),
    (
        ['force_sensor.capacity="8 N"'],
        (
            "limits.hard_force: 10 N exceeds the force sensor's capacity 8 N; lower hard_force, or "
            "correct force_sensor.capacity from the calibration sheet"
        ),
    ),
    (
        ['protocol.force_targets=["0.05 N", "1 N"]'],
        (
            "protocol.force_targets: 0.05 N is not above contact_force 0.05 N; raise the target or "
            "lower contact_force"
        ),
    ),
    (
        ['limits.lateral_force="7 N"'],
        (
            "limits.lateral_force: 7 N is above soft_force 6 N: friction pulls sideways with less "
            "than what presses; lower lateral_force"
        ),
    ),
    (
        ['protocol.force_tolerance="0.3 N"'],
        (
            "protocol.force_tolerance: 0.3 N is more than 20% of the lowest target 1.2556 N; lower "
            "force_tolerance or raise the target"
        ),
    ),
    (
        ['workspace.x_max="500 mm"'],
        (
            "workspace.x_max: the box is 550 mm wide along x; over one gel at most 500 mm are of "
            "use; draw it close around gel and home"
        ),
    ),
    (
        ['camera.rate="10 fps"'],
        (
            "camera.rate: 10 fps is below protocol.min_image_rate 15 fps: every press would fail; "
            "raise rate or lower min_image_rate"
        ),
    ),
    (
        ['force_sensor.rate="50 Hz"'],
        (
            "force_sensor.rate: 50 Hz is below protocol.min_force_rate 95 Hz: every press would "
            "fail; raise rate or lower min_force_rate"
        ),
    ),
    (
        ['limits.early_contact="0.05 N"'],
        "limits.early_contact: 0.05 N is not above contact_force 0.05 N; raise early_contact",
    ),
    (
        ['protocol.tare_deviation="0.06 N"'],
        (
            "protocol.tare_deviation: 0.06 N of allowed noise hides a contact of 0.05 N; lower "
            "tare_deviation or raise contact_force"
        ),
    ),
    (
        ['workspace.x_min="60 mm"', 'workspace.x_max="55 mm"'],
        "workspace.x_min: 60 mm is not below x_max 55 mm; swap or correct the two",
    ),
    (
        ['robot.home=["90 mm", "-400 mm", "230 mm"]'],
        "robot.home: (90, -400, 230) mm lies outside the workspace box; correct it or the box",
    ),
    (
        ['robot.home=["0 mm", "-400 mm", "215 mm"]'],
        "robot.home: is 15 mm above the gel; the air press and approach need 22 mm; raise home",
    ),
    (
        ['workspace.z_min="198 mm"'],
        (
            "workspace.z_min: 198 mm stops the arm before max_depth below the lowest expected "
            "surface, 197 mm; lower z_min or max_depth"
        ),
    ),
    (
        ['protocol.approach_height="1 mm"'],
        ("protocol.approach_height: 1 mm may touch a surface known to 1 mm; raise approach_height"),
    ),
    (
        ['robot.driver="ur5"'],
        "robot.host: is empty; give the controller's address, e.g. 192.168.0.10",
    ),
    (
        ['force_sensor.driver="m3733c"'],
        "force_sensor.port: is empty; give the port, e.g. /dev/serial/by-id/...",
    ),
    (
        ['force_sensor.driver="m3733c"', "force_sensor.calibration_sheet="],
        (
            "force_sensor.calibration_sheet: is empty; capacity has no other source; name the "
            "calibration sheet that came with the sensor (number and date)"
        ),
    ),
    (
        ['robot.press_speed="0.5 mm/s"', 'limits.max_depth="0.2 mm"'],
        "robot.press_speed: 0.5 mm/s overruns by 25 um; lower press_speed",
    ),
]


@pytest.mark.parametrize(
    ("overrides", "line"), BROKEN, ids=[line.split(":")[0] for _, line in BROKEN]
)
def test_a_limit_that_cannot_hold_is_refused(overrides: list[str], line: str) -> None:
    """The message has the field, both values with their units, and the way out."""
    with pytest.raises(ConfigError) as caught:
        load_config(overrides=overrides)
    assert line in caught.value.message.split("\n")
    assert "tacauchy-rig config show" in caught.value.remedy
