"""Make a folder of presses from an exported run, as a laboratory might send it."""

import csv
import shutil
from pathlib import Path

lab = Path("lab")
lab.mkdir()
rows = []
with Path("csv/trials.csv").open() as file:
    trials = list(csv.DictReader(file))
for trial in trials:
    folder = Path("csv") / f"trial-{int(trial['trial']):02d}-attempt-{trial['attempt']}"
    frames = list(csv.DictReader((folder / "frames.csv").open()))
    for state, start in (("unloaded", "reference_start_ns"), ("pressed", "dwell_start_ns")):
        file = next(f["file"] for f in frames if int(f["stamp_ns"]) > int(trial[start]))
        name = f"press{trial['trial']}-{state}.jpg"
        shutil.copy(folder / file, lab / name)
        pressed = state == "pressed"
        force = trial["force_measured_n"] if pressed else 0
        rows.append(
            [name, trial["trial"], state, force, trial["depth_measured_m"] if pressed else ""]
        )
with (lab / "presses.csv").open("w", newline="") as file:
    csv.writer(file).writerows([["file", "trial", "state", "fz", "depth"], *rows])
