"""Commands on run folders: ``replay``, ``report``, ``recover``, ``export``, ``serve``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sim.tolerance import Tolerance, parse_tolerance
from tacauchy_rig.app.cli.live_viewing import open_in_browser, tell
from tacauchy_rig.app.cli.output import Found, RunFolder, complain, say
from tacauchy_rig.app.exporting.formats import Format
from tacauchy_rig.app.exporting.formats import export as write
from tacauchy_rig.core.errors import AbortedError, command_line
from tacauchy_rig.core.parallel import worker_process
from tacauchy_rig.core.time_limit_and_progress import doing, heard, told

if TYPE_CHECKING:
    from protocols.processes.child_process import Viewing
    from reports.evidence.frames_and_curves import RunReading
    from tacauchy_rig.app.replay.chosen_optics import Calibrate
    from tacauchy_rig.core.simulated import Replay
    from tacauchy_rig.core.store.check.run_and_press_check import RunCheck
    from tacauchy_rig.core.store.recovery import RunRecovery


def replay(
    folder: RunFolder,
    *,
    tolerance: str | None = None,
    optics: Path | None = None,
    watch: bool = False,
) -> Found | None:
    """Simulate the trials of a run again and write its report.

    Example: tacauchy-rig replay runs/20261123-gelsight-mini --tolerance 1%

    Args:
        tolerance (0.02N|1%): Take the cheapest preset that keeps the error of F_z within it.
        optics (FILE): Render with this calibration in place of the run's own; finished presses
            stay.
        watch: Only let a twin follow the recorded forces, and write a page with a time slider:
            camera and twin, pressure, shear, residual.
    """
    with doing("checking the recordings"):  # and loading the program, on a busy computer
        from tacauchy_rig.app.cli.emulated_calibration import (
            begin_calibration,
            emulated_calibration,
        )
        from tacauchy_rig.app.replay.open_run import open_run
        from tacauchy_rig.core.store.check.run_and_press_check import check_run

        run = open_run(folder)
        kept = None if tolerance is None else parse_tolerance(tolerance, field="--tolerance")
        with run.store.lock():  # refuses a busy or read-only run before the simulation
            pass
        complain_of(check_run(run.store))
    if watch:
        _watch(run, optics)
        return None
    with worker_process() as worker:
        calibrate = emulated_calibration(run.store)
        if optics is None:
            calibrate = begin_calibration(run.store, worker)
        replay_and_show(run, calibrate, tolerance=kept, optics=optics)
    return reported(run)


def _watch(run: RunReading, given: Path | None) -> None:
    """Write the page of a run and its twin."""
    from tacauchy_rig.app.cli.emulated_calibration import emulated_calibration
    from tacauchy_rig.app.replay.chosen_optics import optics_of
    from tacauchy_rig.app.replay.simulator_inputs import sensor_of
    from tacauchy_rig.app.twin.run_follower import watch_run

    config = run.store.config
    with heard(say):
        optics = optics_of(
            config.sensor.optics_calibration if given is None else str(given),
            sensor_of(config),
            calibrate=emulated_calibration(run.store),
        )
        say(f"page {watch_run(run, optics=optics).resolve()}")


def report(folder: RunFolder) -> Found:
    """Write the report of a run again from its recording and replay.

    Example: tacauchy-rig report runs/20261123-gelsight-mini
    """
    from tacauchy_rig.app.replay.open_run import open_run

    return reported(open_run(folder))


def recover(folder: RunFolder) -> Found:
    """Repair interrupted recordings and check a run's files; exit code 1 if something is lost.

    Example: tacauchy-rig recover runs/20261123-gelsight-mini
    """
    from tacauchy_rig.core.store.recovery import recover_run
    from tacauchy_rig.core.store.run_store import RunStore

    recovery = recover_run(RunStore.open(folder))
    say_recovered(recovery)
    if recovery.is_whole and not any(report.changed for report in recovery.recordings):
        say(f"{folder}: journal, results and recordings are whole and agree")
    return Found(recovery, passed=recovery.is_whole)


def say_recovered(recovery: RunRecovery) -> None:
    """Say what was mended of a run, and what is not to be mended."""
    for report in recovery.recordings:
        if report.changed:
            merged = f", {report.merged_count} of them from spills" if report.merged_count else ""
            say(
                f"{report.path}: was {report.before}; {report.message_count} messages readable"
                f"{merged}; the original is kept as {report.original}"
            )
        for problem in report.problems:
            say(f"{report.path}: {problem}")
    if recovery.was_cut_off:
        say("the journal had no end: the program was cut off, or lines were taken off; noted in it")
    complain_of(recovery.check)


def complain_of(check: RunCheck) -> None:
    """Say what contradicts what in a run."""
    for line in check.missed():
        complain(f"error: {line}")


def replay_and_show(
    run: RunReading,
    calibrate: Calibrate | None,
    *,
    tolerance: Tolerance | None = None,
    optics: Path | None = None,
    page: Viewing | None = None,
) -> None:
    """Replay a run, and print the stated error of its forces; a page is told, too."""

    def show(text: str) -> None:
        say(text)
        tell(page, "analysing", text.strip())

    try:
        with told(show), heard(show), doing("replay"):
            from tacauchy_rig.app.replay.replay import replay_run

            replay = replay_run(run, tolerance=tolerance, optics_file=optics, calibrate=calibrate)
    except KeyboardInterrupt:
        raise AbortedError(
            "aborted by Ctrl-C during the replay; recordings and finished places are kept",
            remedy=f"`{command_line('replay', run.store.paths.root)}` continues it",
        ) from None
    for found in (each for model in replay.models for each in model.markers if each.tracked):
        lengths_m = found.recorded_largest_m, found.simulated_largest_m, found.apart_rms_m
        recorded, simulated, apart = (f"{(each or 0.0) * 1e3:.3f} mm" for each in lengths_m)
        say(
            f"  markers of trial {found.trial}: {found.tracked} tracked, moved {recorded} at most, "
            f"the simulated ones {simulated}; {apart} apart rms, "
            f"{found.apart_median_px or 0.0:.2f} px in the median"
        )
    _say_cost(replay)


def reported(run: RunReading, *, page: Viewing | None = None) -> Found:
    """Write the report of a run, say where it is, and return its summary."""
    from tacauchy_rig.app.replay.report_run import report_run

    say("writing the report")
    tell(page, "analysing", "writing the report")
    with doing("writing the report"):
        report, paths = report_run(run)
    tell(page, "reported", report.verdict, passed=report.passed)
    say(report.verdict)
    say(f"report {paths.html.resolve()}")
    say(f"next: {command_line('serve', run.store.paths.root.parent)} shows it beside other runs")
    return Found(json.loads(paths.summary.read_text("utf-8")), passed=report.passed)


def _say_cost(replay: Replay) -> None:
    """Print the stated error of the forces, the cost, and that of neighbouring settings."""
    from tacauchy_rig.app.cli.press import cost_lines

    model = replay.model
    worst = max(replay.trials, key=lambda trial: trial.force_error_estimate or float("inf"))
    errors = [each.force_error_largest_relative for each in replay.models]
    known = [error for error in errors if error is not None]
    error = max(known) if len(known) == len(errors) else None
    cost = f"{sum(each.wall_s for each in replay.models):.1f} s"
    for line in cost_lines(error, worst.force_error_basis, cost, model.alternatives):
        say(f"  {line}")


def export(
    source: Path,
    out: Path,
    *,
    to: Format = Format.CSV,
    sensor: str = "gelsight-mini",
    background: Path | None = None,
) -> Found:
    """Export runs, data sets, presses, calibrations and sensors to other programs.

    Example: tacauchy-rig export runs/20261123-gelsight-mini exported --to lerobot

    Args:
        source (SOURCE): Folder of a run, of a sweep (lerobot, hdf5, rosbag2, webdataset, zarr) or
            of `press --out` (vtu, usd); file of `calibrate optics` (isaaclab, taxim, tacex); or
            name of a sensor (isaaclab, taxim, tacex, usd, pressure-law).
        out (FOLDER): A new folder to write to.
        to: The format to write.
        sensor: The sensor that was calibrated.
        background (IMAGE): Its no-contact frame; an even grey if absent.
    """
    with doing("exporting"):
        write(source, out, to, sensor=sensor, background=background)
    written = sorted(path for path in out.rglob("*") if path.is_file())
    size_mb = sum(path.stat().st_size for path in written) / 1e6
    say(f"wrote {len(written)} files, {size_mb:.1f} MB, to {out}")
    return Found({"files": written})


def serve(
    folder: Path = Path("runs"),
    *,
    port: Annotated[int, typer.Option(min=0)] = 0,
    open_: bool = False,
) -> None:
    """Serve pages of runs: verdicts, reports, comparison of two runs, health of a sensor.

    It changes nothing. Only this machine can reach the printed address.

    Example: tacauchy-rig serve runs --open

    Args:
        folder (RUNS): Folder of runs, or one run.
        port: 0 takes a free one.
        open_: Open the page in a browser.
    """
    with doing("loading the pages"):
        import secrets

        import uvicorn

        from protocols.processes.child_process import listen
        from protocols.processes.page.access_token import AccessRule
        from tacauchy_rig.app.results.results_pages import ResultsServer, folder_of_runs

        root, only = folder_of_runs(folder)
    with listen(port, option="--port") as taken:
        number = taken.getsockname()[1]
        access = AccessRule(secrets.token_urlsafe(16), port=number)
        address = f"http://127.0.0.1:{number}/{access.token}/"
        say(f"runs of {root} at {address} (Ctrl-C ends)")
        if open_:
            open_in_browser(address)
        app = ResultsServer(root, access, only=only).app
        config = uvicorn.Config(
            app, http="h11", ws="none", lifespan="off", log_level="warning", server_header=False
        )
        uvicorn.Server(config).run(sockets=[taken])
