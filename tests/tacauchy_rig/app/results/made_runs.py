"""Runs to look at, and a browser's requests to a server of them."""

import http.client
import json
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
import uvicorn

from protocols.processes.page.access_token import AccessRule
from reports.evidence.frames_and_curves import RunReading
from tacauchy_rig.app.gel_health import GelState, PressMeasures, compare_presses
from tacauchy_rig.app.results.results_pages import ResultsServer
from tacauchy_rig.core.run import Outcome, TrialRecord
from tests.recorded_run import empty_run

TOKEN = "first-part-of-the-path"  # noqa: S105 - of a server that lives for a test
VERDICT = "Passed: <b>six</b> presses"
NAMES = "20261101-first", "20261102-second", "20261103-aborted", "20261104-damaged"


def made_run(root: Path, name: str, *, force_n: float, outcome: Outcome = Outcome.PASSED) -> Path:
    """Make a run of one press that came to a force, without recordings."""
    store = empty_run(root)
    record = TrialRecord(
        index=1, attempt=1, outcome=outcome, force_target_n=1.26, force_measured_n=force_n
    )
    store.paths.attempt(1, 1).mkdir(parents=True)
    store.save_result(record)
    return store.paths.root.rename(root / name)


def reported(folder: Path, *, modulus: float) -> None:
    """Give a run what a report leaves."""
    report = folder / "report"
    (report / "figures").mkdir(parents=True)
    (report / "figures" / "images.pdf").write_bytes(b"%PDF-1.4")
    (report / "report.html").write_text("<title>report</title><script>1</script>", "utf-8")
    trial = {"index": 1, "force_measured_n": 1.25, "force_deviation_n": 0.01}
    summary = {
        "passed": True,
        "verdict": VERDICT,
        "model": {"modulus_factor": modulus, "modulus_factor_deviation": 0.02},
        "statistics": {"metrics": {"ssim": {"mean": 0.99, "deviation": None}}},
        "trials": [trial],
    }
    (report / "summary.json").write_text(json.dumps(summary), "utf-8")


def judged(before: RunReading, now: RunReading) -> GelState:
    """A gel that became a fifth stiffer, whatever was recorded."""
    depth_m = np.linspace(0.0, 4e-4, 100)
    seen = PressMeasures(
        depth_m=depth_m,
        force_n=5e3 * depth_m,
        unloaded=np.full((8, 8, 3), 100.0),
        pressed=np.full((8, 8, 3), 120.0),
        zero_n=0.1,
        zero_deviation_n=0.01,
    )
    stiffer = replace(seen, force_n=6e3 * depth_m)
    same = before.store.paths.root == now.store.paths.root
    return compare_presses(seen, seen if same else stiffer, depth_uncertainty_m=5e-6)


@dataclass(frozen=True)
class Answer:
    """What a request got."""

    status: int
    text: str
    headers: dict[str, str]


@dataclass(frozen=True)
class Client:
    """A browser on this machine that takes paths as they are written."""

    port: int

    @property
    def address(self) -> str:
        """Of the page, token included."""
        return f"http://127.0.0.1:{self.port}/{TOKEN}/"

    def of_run(self, name: str, path: str) -> Answer:
        """Ask for a file of a run by the key that the list of runs links to."""
        key = AccessRule(TOKEN, port=self.port).narrowed(name).token
        return self.get(f"/{key}/run/{name}/{path}", whole=True)

    def get(self, path: str, *, whole: bool = False, method: str = "GET", **headers: str) -> Answer:
        """Ask for a path below the token, or for a whole one."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=20)
        try:
            place = path if whole else f"/{TOKEN}/{path}"
            connection.request(method, place, headers=headers)
            answer = connection.getresponse()
            told = {name.lower(): value for name, value in answer.headers.items()}
            return Answer(answer.status, answer.read().decode("utf-8", "replace"), told)
        finally:
            connection.close()


@contextmanager
def served(runs: Path, *, only: str = "") -> Iterator[Client]:
    """Serve a folder of runs meanwhile."""
    listener = socket.socket()
    listener.bind(("127.0.0.1", 0))
    port = listener.getsockname()[1]
    results = ResultsServer(runs, AccessRule(TOKEN, port=port), only=only)
    # uvicorn's own settings of logging would close the handlers of other packages, and with them
    # the files that pytest captures into.
    config = uvicorn.Config(results.app, http="h11", ws="none", lifespan="off", log_config=None)
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    try:
        with patch("tacauchy_rig.app.results.results_pages.compare_runs", judged):
            yield Client(port)
    finally:
        server.should_exit = True
        thread.join()
