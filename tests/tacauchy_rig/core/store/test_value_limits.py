"""What a run's files may hold: numbers that can be."""

from __future__ import annotations

import math
from typing import Any

import pytest

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.expected_press import ExpectedPress
from tacauchy_rig.core.run import TrialRecord
from tacauchy_rig.core.store.codec import read_value

TARE = {"start_ns": 5, "end_ns": 6, "deviation": [0.0] * 6, "sample_count": 5}
RECORD: dict[str, Any] = {
    "index": 1,
    "attempt": 2,
    "outcome": "passed",
    "force_target_n": 1.2556,
    "criteria": [{"name": "a", "passed": True, "measured": 1.0, "limit": "", "unit": ""}],
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"force_measured_n": "Infinity"}, "force_measured_n: inf is no number"),
        ({"contact_z_m": "NaN"}, "contact_z_m: nan is no number"),
        ({"force_measured_n": 10**300}, r"force_measured_n: 1e\+300 cannot be: -1e\+06 to 1e\+06"),
        ({"dwell_start_ns": -1, "dwell_end_ns": 9}, "dwell_start_ns: -1 cannot be: 0 to"),
        ({"dwell_end_ns": 2**62 + 1}, "dwell_end_ns: 4611686018427387905 cannot be"),
        ({"reference_start_ns": 9, "reference_end_ns": 8}, "reference_end_ns: 8 lies before its"),
        ({"tare_before": {**TARE, "mean": [math.inf] * 6}}, r"tare_before.mean\[0\]: inf is no"),
        ({"tare_before": {**TARE, "mean": [0.0] * 6, "end_ns": 4}}, "tare_before.end_ns: 4 lies"),
        ({"press_force_n": [1.0, "-Infinity"]}, r"press_force_n\[1\]: -inf is no number"),
        ({"rates": {"force_count": 1e300}}, r"rates.force_count: 1e\+300 cannot be"),
        ({"attempt": -1}, "attempt: -1 cannot be: 0 to"),
    ],
)
def test_a_number_that_cannot_be_is_refused(change: dict[str, Any], message: str) -> None:
    """By file, field and value, with a remedy."""
    with pytest.raises(RecordError, match=f"^result.json: {message}") as caught:
        read_value(TrialRecord, {**RECORD, **change}, source="result.json")
    assert "take it from a copy of the run" in caught.value.remedy


def test_what_is_not_known_is_read() -> None:
    """NaN where there is no None, and anything that a criterion measured."""
    nobody_asked = {**RECORD, "force_target_n": "NaN"}
    unmeasured = {**RECORD["criteria"][0], "measured": "Infinity"}
    moments = {**TARE, "mean": [0.0, 0.0, 1.0, "NaN", "NaN", "NaN"]}
    data = {**nobody_asked, "criteria": [unmeasured], "tare_before": moments}
    record = read_value(TrialRecord, data, source="result.json")
    assert math.isnan(record.force_target_n)
    assert record.criteria[0].measured == math.inf


def test_other_files_of_a_run_are_held_to_the_same(expected: dict[str, Any]) -> None:
    """Lists of a simulator's answer, too."""
    assert read_value(ExpectedPress, expected, source="expected.json").low == 0.8
    with pytest.raises(RecordError, match=r"expected.json: force_n\[1\]: inf is no number"):
        read_value(ExpectedPress, {**expected, "force_n": [0, "Infinity"]}, source="expected.json")


@pytest.fixture
def expected() -> dict[str, Any]:
    """Return what was expected of a press, as it is written."""
    curve = {
        "sensor": "",
        "made": "",
        "depth_m": [0.0, 1e-3],
        "force_n": [0.0, 5.0],
        "low": 0.8,
        "high": 1.2,
    }
    return {**curve, "lean_m": 0.0, "depth_error_m": 0.0, "gel_height_m": 4e-3}
