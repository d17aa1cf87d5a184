"""What the benchmark measured, as tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from sim.studies.bench.batch_tables import TIMES, batches_section, parts_section, stress_section
from sim.studies.bench.frames import CLOSE, FORCE_ERROR_MAX, FRAME_COUNT, TRAVEL_M
from sim.studies.bench.peer.comparison import peer_section
from sim.studies.bench.press_parts import EXPONENT_WANTED, exponent, local_exponents
from sim.studies.bench.rendering import BATCH, BLUR_PX, SAMPLES
from sim.studies.bench.replays import FORCE_ERROR_MAX as REPLAY_ERROR_MAX
from sim.studies.bench.replays import MEMORY_MAX_MIB, TIME_MAX_S
from sim.studies.bench.suite import Bench
from tacauchy_rig.tables import Table

FAST_FRAMES_PER_S, CLOSE_FRAMES_PER_S = 98.0, 30.0
# Of an image [ms].
_ONE_MS, _OF_A_BATCH_MS = 5.0, 0.2


def sections(found: Bench) -> list[Table]:
    """Return the tables of what was measured, in the order of the page."""
    tables: dict[Callable[[Bench], Table], Sequence[object]] = {
        _frames: found.frames,
        _reuse: found.reuse,
        batches_section: found.batches,
        stress_section: found.batches,
        parts_section: found.batches,
        _peers: found.peers,
        _phases: found.phases,
        _rendering: found.rendering,
        _replays: found.replays,
        _growth: found.growth,
    }
    return [table(found) for table, rows in tables.items() if rows]


def _frames(found: Bench) -> Table:
    close = [row for row in found.frames if abs(row.force_error) <= FORCE_ERROR_MAX]
    return Table(
        title="Frames a second",
        columns=(
            "preset",
            "tetrahedra",
            "unknowns",
            "F_z off by [%]",
            "iterations",
            "factorisations",
            "set-up [s]",
            "frame [ms]",
            "processor time of it [ms]",
            "frames [1/s]",
            "peak memory [MiB]",
        ),
        rows=tuple(
            (
                row.setting,
                row.tet_count,
                row.unknown_count,
                1e2 * row.force_error,
                row.newton_iterations,
                row.factorisations,
                row.setup_s,
                row.frame_ms,
                1e3 * row.cpu_s / FRAME_COUNT,
                row.frames_per_s,
                row.memory_mib,
            )
            for row in found.frames
        ),
        criterion=f"on two cores at least {FAST_FRAMES_PER_S:g} frames/s with preset fast, and at "
        f"least {CLOSE_FRAMES_PER_S:g} with F_z within {FORCE_ERROR_MAX:.0%} of preset accurate's",
        passed=found.frames[0].frames_per_s >= FAST_FRAMES_PER_S
        and max((row.frames_per_s for row in close), default=0.0) >= CLOSE_FRAMES_PER_S,
        note=f"An indenter travels {TRAVEL_M * 1e3:g} mm into the gel in {FRAME_COUNT} frames, "
        "each an equilibrium, from the untouched gel on and with nothing known of it but its mesh. "
        "F_z is that of the last frame. Finer meshes are tried until it is within "
        f"{CLOSE:.0%}, since preset accurate's may be 1 % above the limit of fine meshes. Time is "
        "the least of ten travels. Memory is the process's peak so far, the press with preset "
        "accurate included.",
    )


def _reuse(found: Bench) -> Table:
    first = found.reuse[0]
    return Table(
        title="What reuse saves",
        columns=(
            "way",
            "evaluations",
            "factorisations",
            "processor time [s]",
            "over the first",
            "F_z [N]",
        ),
        rows=tuple(
            (
                row.way,
                row.evaluations,
                row.factorisations,
                row.cpu_s,
                row.cpu_s / first.cpu_s,
                row.force_n,
            )
            for row in found.reuse
        ),
        criterion=TIMES,
        passed=True,
        note="The travel of the frames with preset fast, in its own way and in others that each "
        "leave one thing out, all on the same mesh; then the forces of a replay. An evaluation is "
        "one of the forces. F_z is that at the end.",
    )


def _peers(found: Bench) -> Table:
    return peer_section(found.batches, found.peers)


def _phases(found: Bench) -> Table:
    names = dict.fromkeys(row.name for row in found.phases)
    presets = dict.fromkeys(row.preset for row in found.phases)
    times = {(row.name, row.preset): row for row in found.phases}
    return Table(
        title="Parts of the work",
        columns=(
            "part",
            *(f"{preset}, {what} [ms]" for preset in presets for what in ("median", "least")),
        ),
        rows=tuple(
            (
                name,
                *(
                    1e3 * seconds
                    for preset in presets
                    for seconds in (times[name, preset].median_s, times[name, preset].least_s)
                ),
            )
            for name in names
        ),
        criterion=TIMES,
        passed=True,
        note="Each alone, on the state at the end of a press. Assembly: energy, gradient and "
        "Newton matrix of the elements. Contact: gaps, energy, forces and their sum at the nodes. "
        "Solution: one right side. These are done about once a Newton iteration; the stress on the "
        "surface, the height map and the image once a frame. Height map and image are of one "
        "sample a pixel, with the nominal lamps of the sensor's file and no blur, and rendering "
        "includes setting up the renderer for that one image. An image from a renderer that is "
        "kept is under Rendering, those that a replay makes under Replay of a run.",
    )


def _rendering(found: Bench) -> Table:
    limits = {"one by one": _ONE_MS, "batch": _OF_A_BATCH_MS}
    first = found.rendering[0]
    judged = [row for row in found.rendering if row.image_count in (1, BATCH)]
    return Table(
        title="Rendering",
        columns=(
            "sensor",
            "renderer",
            "device",
            "images",
            "samples",
            "shadows",
            "image [ms]",
            "least [ms]",
            "apart [levels]",
            "apart [%]",
        ),
        rows=tuple(
            (
                row.sensor,
                row.renderer,
                row.device,
                row.image_count,
                f"{row.samples}x{row.samples}",
                row.shadow_count,
                row.image_ms,
                1e3 * row.least_s / row.image_count,
                row.apart_levels,
                1e2 * row.apart_share,
            )
            for row in found.rendering
        ),
        criterion=f"an image alone in {_ONE_MS:g} ms on two cores, one of a batch of {BATCH} on a "
        f"GPU in {_OF_A_BATCH_MS:g} ms, no value more than one level from the image alone",
        passed=all(row.image_ms < limits[row.renderer] for row in judged)
        and all(row.apart_levels <= 1 for row in found.rendering),
        note=f"From a height map to {first.width_px} x {first.height_px} pixels of bytes: slopes, "
        f"a model of {first.term_count} terms (a polynomial, near lamps and creases), the shadows "
        f"of as many lamps as the sensor's file asks for, a blur of {BLUR_PX:g} px, rounding. A "
        f"replay takes {SAMPLES} x {SAMPLES} samples of each pixel. A time is the median over "
        "repeats; the height map and the renderer are made before it begins. "
        "Dents and images of a batch stay on its device; how far its images are apart from those "
        "rendered one by one is the largest difference, and the share of values that differ."
        + "".join(f" Not measured: {text}." for text in found.absent if "images" in text),
    )


def _replays(found: Bench) -> Table:
    within = [row for row in found.replays if row.is_within]
    return Table(
        title="Replay of a run",
        columns=(
            "preset",
            "presses",
            "F_z believed within [%]",
            "iterations",
            "presses and fields [s]",
            "images [s]",
            "together [s]",
            "peak memory [MiB]",
        ),
        rows=tuple(
            (
                row.preset,
                row.trial_count,
                None if row.force_error is None else 1e2 * row.force_error,
                row.newton_iterations,
                row.presses_s,
                row.images_s,
                row.wall_s,
                row.memory_mib,
            )
            for row in found.replays
        ),
        criterion=f"F_z within {REPLAY_ERROR_MAX:.0%}, images and mesh included, in less than "
        f"{TIME_MAX_S:g} s and {MEMORY_MAX_MIB:.0f} MiB (2 GB) on two cores",
        passed=any(row.wall_s < TIME_MAX_S and row.memory_mib < MEMORY_MAX_MIB for row in within),
        note="The forces of the dry run, met on one loading path, with fields; then the height "
        "maps and the image of each press, as a replay makes them: a height map of "
        f"{SAMPLES} x {SAMPLES} samples a pixel for the image, one of a value a pixel to keep, and "
        "a renderer set up anew for each press. The height maps are most of it. Memory is the "
        "process's peak so far.",
    )


def _growth(found: Bench) -> Table:
    sizes = [float(row.tet_count) for row in found.growth]
    spent = [row.cpu_s for row in found.growth]
    each = [row.cpu_s / row.newton_iterations for row in found.growth]
    power = exponent(sizes, spent)
    steps = [None, *local_exponents(sizes, spent)]
    return Table(
        title="Growth with elements",
        columns=(
            "edges shorter by",
            "tetrahedra",
            "nodes",
            "iterations",
            "processor time [s]",
            "of an iteration [ms]",
            "exponent from the row above",
        ),
        rows=tuple(
            (
                row.refinement,
                row.tet_count,
                row.node_count,
                row.newton_iterations,
                row.cpu_s,
                1e3 * iteration,
                step,
            )
            for row, iteration, step in zip(found.growth, each, steps, strict=True)
        ),
        criterion=f"time grows no faster than the elements to the power of {EXPONENT_WANTED:g}",
        passed=power <= EXPONENT_WANTED,
        note=f"Fitted through all rows: time goes with the elements to the power of {power:.2f}, "
        f"that of one iteration to the power of {exponent(sizes, each):.2f}. The same press with "
        "the same settings on finer and finer meshes; processor time, so that a busy machine "
        "changes it little.",
    )
