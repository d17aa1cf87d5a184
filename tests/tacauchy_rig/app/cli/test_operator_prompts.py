"""What is shown before a real arm moves."""

from tacauchy_rig.app.cli.operator_prompts import confirmation_screen, expected_answer
from tacauchy_rig.core.config.load import load_config


def test_the_screen_shows_speeds_forces_and_workspace():
    """Every number that limits the motion stands there with its unit."""
    screen = confirmation_screen(load_config().config)
    for text in (
        "1.2556, 1.9511, 2.6466, 3.3422, 4.0377, 4.7332 N",
        "6 N stops and retracts, 10 N triggers a protective stop",
        "approach 10 mm/s, search 0.5 mm/s, press 0.3 mm/s, retract 10 mm/s",
        "x -50 to 50 mm, y -450 to -350 mm",
        "z 196 to 300 mm; tilt up to 3 deg",
        "20 mm above",
        "not a safety system",
    ):
        assert text in screen
    assert len(screen.splitlines()) <= 24
    assert max(map(len, screen.splitlines())) <= 100


def test_the_answer_is_the_sensor_s_name():
    """A sensor of one's own is named by its file."""
    assert expected_answer(load_config().config) == "gelsight-mini"
    own = load_config(overrides=['sensor.name="/data/sensors/unit-7.toml"']).config
    assert expected_answer(own) == "unit-7"
