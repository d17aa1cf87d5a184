"""Ways to tamper with what stands beside the recordings: results, journal, description, replay."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator

import numpy as np

from tacauchy_rig.rgb import decode_rgb, encode_png
from tacauchy_rig.tampering.case import TORN, TamperCase
from tacauchy_rig.tampering.copy import Json, RunCopy
from tacauchy_rig.tampering.recordings import OTHER, VICTIM

_MOVED_NS = 200_000_000
_DEEPER_M = 1e-4


def result_cases() -> Iterator[TamperCase]:
    """Yield every case of a result."""
    yield _result("forces halved", _halve)
    yield _result("outcome of a failed attempt made passed", _forgiven)
    yield _result("0.1 mm deeper", lambda r: _add(r, "depth_measured_m", _DEEPER_M))
    yield _result("contact 0.1 mm higher", lambda r: _add(r, "contact_z_m", _DEEPER_M))
    yield _result("dwell 0.2 s earlier", _moved_dwell)
    yield _result("another target", lambda r: r.update(force_target_n=r["force_target_n"] + 0.5))
    yield _result("another zero", _moved_zero)
    yield _result("drift made none", lambda r: r.update(force_drift_n=0.0))
    yield _result("of another attempt", lambda r: r.update(attempt=r["attempt"] + 1))
    yield TamperCase(name="result: exchanged with another trial's", change=_swap_results)
    yield TamperCase(name="result: cut in half", change=_cut_result, cares=TORN)
    yield TamperCase(name="result: deleted", change=lambda c: c.result(VICTIM).unlink())


def journal_cases() -> Iterator[TamperCase]:
    """Yield every case of the journal, the description and the configuration."""
    yield _journal("a line deleted", lambda lines: [*lines[:5], *lines[6:]])
    yield _journal("a line twice", lambda lines: [*lines[:6], *lines[5:]])
    yield _journal("two lines exchanged", lambda n: [*n[:5], n[6], n[5], *n[7:]])
    yield _journal("force at an attempt's end edited", _edited_end)
    yield _journal("an attempt's lines deleted", _without_attempt)
    yield _journal("cut short by its last lines", lambda lines: lines[: 2 * len(lines) // 3])
    yield TamperCase(name="journal: a line made unreadable", change=_garbled_line, cares=TORN)
    yield TamperCase(
        name="journal: deleted", change=lambda copy: copy.paths.journal.unlink(), cares=TORN
    )
    yield _described("sign of the cell flipped", _flip_sign)
    yield _described("emulated devices made real", lambda d: d.update(simulated=False))
    yield _described("a device's serial number edited", _other_device)
    yield TamperCase(name="rig.toml: edited", change=_edited_toml)
    yield TamperCase(name="attempt: its folder deleted", change=_without_folder)
    yield TamperCase(name="attempt: its folder doubled as a later one", change=_doubled_folder)


def replay_cases() -> Iterator[TamperCase]:
    """Yield every case of a replay."""
    yield TamperCase(name="replay: images without contact", change=_no_contact)
    yield TamperCase(name="replay: a trial's image is another's", change=_other_image)
    yield TamperCase(name="replay: an image damaged", change=_cut_image, cares=TORN)
    yield _replayed("simulated force edited", lambda t: _add(t, "force_simulated_n", 0.01))
    yield _replayed("pressed to another force", lambda t: _add(t, "force_measured_n", 0.5))
    yield TamperCase(name="replay: deleted", change=lambda copy: shutil.rmtree(copy.replay))


def _result(name: str, change: Callable[[Json], None]) -> TamperCase:
    return TamperCase(
        name=f"result: {name}",
        change=lambda copy: copy.change_json(copy.result(VICTIM), change),
    )


def _journal(name: str, change: Callable[[list[Json]], list[Json]]) -> TamperCase:
    return TamperCase(name=f"journal: {name}", change=lambda copy: copy.change_journal(change))


def _described(name: str, change: Callable[[Json], None]) -> TamperCase:
    return TamperCase(
        name=f"run.json: {name}",
        change=lambda copy: copy.change_json(copy.paths.run_json, change),
    )


def _replayed(name: str, change: Callable[[Json], None]) -> TamperCase:
    def changed(copy: RunCopy) -> None:
        path = copy.replay / "replay.json"
        copy.change_json(path, lambda replay: change(replay["trials"][0]))

    return TamperCase(name=f"replay: {name}", change=changed)


def _add(content: Json, field: str, more: float) -> None:
    content[field] += more


def _halve(result: Json) -> None:
    for field in ("force_measured_n", "force_deviation_n", "force_rate_n_s", "force_drift_n"):
        result[field] *= 0.5


def _forgiven(result: Json) -> None:
    """Leave an outcome that its own criteria contradict."""
    result["criteria"][0]["passed"] = False


def _moved_dwell(result: Json) -> None:
    result["dwell_start_ns"] -= _MOVED_NS
    result["dwell_end_ns"] -= _MOVED_NS


def _moved_zero(result: Json) -> None:
    mean = result["tare_before"]["mean"]
    result["tare_before"]["mean"] = [value + 0.05 for value in mean]


def _swap_results(copy: RunCopy) -> None:
    first, second = copy.result(VICTIM), copy.result(OTHER)
    content = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(content)


def _cut_result(copy: RunCopy) -> None:
    path = copy.result(VICTIM)
    path.write_bytes(path.read_bytes()[:200])


def _edited_end(lines: list[Json]) -> list[Json]:
    end = next(line for line in lines if line["name"] == "attempt-end")
    end["detail"]["force_measured_n"] *= 0.5
    return lines


def _without_attempt(lines: list[Json]) -> list[Json]:
    return [line for line in lines if line["trial"] != VICTIM]


def _garbled_line(copy: RunCopy) -> None:
    lines = copy.paths.journal.read_bytes().split(b"\n")
    lines[5] = lines[5][: len(lines[5]) // 2]
    copy.paths.journal.write_bytes(b"\n".join(lines))


def _flip_sign(description: Json) -> None:
    cell = description["config"]["force_sensor"]
    cell["compression_sign"] = -cell["compression_sign"]
    description["written"]["force_sensor.compression_sign"] = cell["compression_sign"]


def _other_device(description: Json) -> None:
    device = next(iter(description["devices"].values()))
    device["serial"] = "another"


def _edited_toml(copy: RunCopy) -> None:
    path = copy.paths.rig_toml
    path.write_text(path.read_text("utf-8") + "\n# edited\n", encoding="utf-8")


def _without_folder(copy: RunCopy) -> None:
    shutil.rmtree(copy.result(VICTIM).parent)


def _doubled_folder(copy: RunCopy) -> None:
    attempt = copy.attempt(VICTIM)
    shutil.copytree(copy.paths.attempt(VICTIM, attempt), copy.paths.attempt(VICTIM, attempt + 1))


def _no_contact(copy: RunCopy) -> None:
    """Put an even image in the place of every simulated one."""
    for path in copy.replay.glob("trials/*/image.png"):
        image = decode_rgb(path.read_bytes())
        if image is not None:
            even = np.broadcast_to(np.median(image, axis=(0, 1)), image.shape)
            path.write_bytes(encode_png(np.ascontiguousarray(even, dtype=np.uint8)))


def _other_image(copy: RunCopy) -> None:
    shutil.copyfile(
        copy.replay / "trials" / f"{OTHER:02d}" / "image.png",
        copy.replay / "trials" / f"{VICTIM:02d}" / "image.png",
    )


def _cut_image(copy: RunCopy) -> None:
    path = copy.replay / "trials" / f"{VICTIM:02d}" / "image.png"
    path.write_bytes(path.read_bytes()[:100])
