"""JSON of the run's types: what goes out comes back, nothing else and no number that cannot be."""

import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.run import Criterion, ExpectedPress, Outcome, Tare, TrialRecord
from tacauchy_rig.core.simulated import MarkerMotion, Replay, ReplayTrial
from tacauchy_rig.core.store.json_codec import (
    dumps,
    from_json,
    loads,
    read_value,
    to_json,
    to_plain,
)
from tests.made_model import made_model

TARE = {"start_ns": 5, "end_ns": 6, "deviation": [0.0] * 6, "sample_count": 5}
RECORD: dict[str, Any] = {
    "index": 1,
    "attempt": 2,
    "outcome": "passed",
    "force_target_n": 1.2556,
    "criteria": [
        {"name": "force_mean", "passed": True, "measured": 1.25, "limit": "", "unit": "N"}
    ],
}


@given(st.from_type(TrialRecord))
def test_any_trial_record_comes_back(record: TrialRecord) -> None:
    """Every field survives, NaN and infinities included."""
    text = dumps(record)
    assert dumps(from_json(TrialRecord, json.loads(text))) == text


@given(
    st.builds(
        Replay,
        trials=st.lists(st.from_type(ReplayTrial), max_size=2).map(tuple),
        model=st.builds(
            made_model,
            optics=st.dictionaries(st.text(), st.integers() | st.text()),
            modulus_factor=st.none() | st.floats(),
            stated_force_history=st.none() | st.just(((1e-4, 0.5), (2e-4, 1.1))),
            markers=st.lists(st.from_type(MarkerMotion), max_size=2).map(tuple),
        ),
    )
)
def test_any_replay_comes_back(replay: Replay) -> None:
    """Nested tuples of numbers come back as tuples."""
    again = from_json(Replay, json.loads(dumps(replay)))
    assert dumps(again) == dumps(replay)
    assert isinstance(again.trials, tuple)
    assert all(isinstance(pair, tuple) for trial in again.trials for pair in trial.force_history)


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan])
def test_what_json_lacks_comes_back_from_a_class_of_pydantic(value: float) -> None:
    """Such classes leave out what is None; no number may look like that."""
    motion = MarkerMotion(trial=1, drawn=2, apart_largest_m=value)
    again = from_json(MarkerMotion, json.loads(dumps(motion))).apart_largest_m
    assert again == value or (math.isnan(value) and again is not None and math.isnan(again))
    assert to_plain(motion)["apart_largest_m"] is None


def test_types_are_rebuilt() -> None:
    """Enums, nested dataclasses and defaults are what the type says."""
    record = from_json(TrialRecord, RECORD)
    assert record.outcome is Outcome.PASSED
    assert record.criteria == (
        Criterion(name="force_mean", passed=True, measured=1.25, limit="", unit="N"),
    )
    assert record.tare_before is None
    assert record.rates == {}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"indx": 3}, "result.json: indx: unknown field"),
        ({"index": None}, "result.json: index: None: Input should be a valid integer"),
        ({"index": True}, "result.json: index: True: Input should be a valid integer"),
        ({"index": 1.5}, "result.json: index: 1.5: Input should be a valid integer"),
        ({"outcome": "good"}, "outcome: 'good': Input should be 'passed', 'failed', 'fault'"),
        ({"force_target_n": "1 N"}, "force_target_n: '1 N': Input should be a valid number"),
        ({"reason": 3}, "reason: 3: Input should be a valid string"),
        ({"criteria": [{"name": "a"}]}, "criteria[0].passed: missing field"),
        ({"criteria": 3}, "criteria: 3: Input should be a valid array"),
        (
            {"rates": {"force_rate_hz": "fast"}},
            "rates.force_rate_hz: 'fast': Input should be a valid",
        ),
        ({"tare_before": {"mean": [0.0]}}, "tare_before.start_ns: missing field"),
    ],
)
def test_what_does_not_fit_is_named(change: dict[str, Any], message: str) -> None:
    """Unknown, missing and mistyped fields are refused with file and field."""
    with pytest.raises(RecordError) as caught:
        from_json(TrialRecord, {**RECORD, **change}, source="result.json")
    assert message in caught.value.message
    assert "another version" in caught.value.remedy


def test_a_vector_of_the_wrong_length_is_named() -> None:
    """A wrench has six components."""
    with pytest.raises(RecordError, match=r"mean\[2\]: missing field"):
        from_json(Tare, {**TARE, "mean": [0.0, 0.0]})


def test_numbers_that_are_none_are_text_for_us_and_null_for_others() -> None:
    """What is read again says which it was; a reader of reports must not meet NaN."""
    value = {"a": math.nan, "b": (1.0, -math.inf), "c": np.array([np.inf, 2.0])}
    assert to_json(value) == {"a": "NaN", "b": [1.0, "-Infinity"], "c": ["Infinity", 2.0]}
    assert to_plain(value) == {"a": None, "b": [1.0, None], "c": [None, 2.0]}
    assert to_plain(Criterion(name="x", passed=True, measured=math.nan, limit="", unit="")) == {
        "name": "x", "passed": True, "measured": None, "limit": "", "unit": "", "remedy": "",
    }  # fmt: skip


def test_numpy_values_and_what_has_no_form() -> None:
    """NumPy numbers and arrays are written; what JSON cannot hold is refused."""
    value = {"a": np.float64(1.5), "b": np.int32(2), "c": np.eye(2), "d": np.bool_(True)}
    assert to_json(value) == {"a": 1.5, "b": 2, "c": [[1.0, 0.0], [0.0, 1.0]], "d": True}
    with pytest.raises(RecordError, match="cannot be written as JSON"):
        to_json({"a": object()})


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (b"{", "line 1"),
        (b'{"index": 1, "a": {"index": 1, "index": 2}}', "'index' stands 2 times in one object"),
        (b"[" * 100_000, "recursion"),
        (b"[" * 100 + b"]" * 100, "nested more than 64 deep"),
        (b"9" * 5000, "digits"),
        (b"9" * 4000, "more than 1024 bits"),
        (rb'"\ud800"', "surrogates not allowed"),
        (b"\xff", "codec can't decode"),
    ],
)
def test_text_that_is_no_json_of_ours(text: bytes, told: str) -> None:
    """It is reported with its file."""
    with pytest.raises(RecordError, match=f"^run.json: not valid JSON: .*{told}"):
        loads(text, source="run.json")


def test_a_message_shows_what_a_terminal_can_print() -> None:
    """Neither a value nor a key of a file fills the screen or moves its cursor."""
    for change in ({"\x1b[2J" * 1000: 1}, {"index": "\x1b[2J" * 1000}):
        with pytest.raises(RecordError) as caught:
            from_json(TrialRecord, {**RECORD, **change}, source="result.json")
        assert caught.value.message.isprintable()
        assert len(caught.value.message) < 300


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
        ({"press_depth_m": ["NaN"]}, r"press_depth_m\[0\]: nan is no number"),
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


def test_other_files_of_a_run_are_held_to_the_same() -> None:
    """Lists of a simulator's answer, too."""
    lengths = {"lean_m": 0.0, "depth_error_m": 0.0, "gel_height_m": 4e-3}
    curve = {"sensor": "", "made": "", "depth_m": [0.0, 1e-3], "force_n": [0.0, 5.0]}
    expected = {**curve, **lengths, "low": 0.8, "high": 1.2}
    assert read_value(ExpectedPress, expected, source="expected.json").low == 0.8
    with pytest.raises(RecordError, match=r"expected.json: force_n\[1\]: inf is no number"):
        read_value(ExpectedPress, {**expected, "force_n": [0, "Infinity"]}, source="expected.json")
