"""Collect ball presses for `calibrate`: python collect_presses.py OUT RUN RUN ..."""

import csv
import sys
from pathlib import Path

import cv2
import numpy as np

from tacauchy_rig import open_run

CENTRE_M = np.array([0.0, -0.4])  # centre of the pad in the base frame
AXES = np.array([[1.0, 0.0], [0.0, 1.0]])  # base frame to x along columns, y along rows

out, folders = Path(sys.argv[1]), [Path(folder) for folder in sys.argv[2:]]
out.mkdir()
unloaded = []
with (out / "positions.csv").open("w", newline="", encoding="utf-8") as file:
    table = csv.writer(file)
    table.writerow(["image", "x_m", "y_m"])
    for folder in folders:
        run = open_run(folder)
        place = AXES @ (np.array(run.store.config.sensor.surface[:2]) - CENTRE_M)
        for trial, record in run.records.items():
            images = run.read(record).images if record and record.passed else None
            if images is None:
                continue
            name = f"{folder.name}-{trial:02d}.png"
            cv2.imwrite(str(out / name), cv2.cvtColor(images.real, cv2.COLOR_RGB2BGR))
            table.writerow([name, *place])
            unloaded.append(images.reference)
rest = np.median(np.stack(unloaded), axis=0).astype(np.uint8)
cv2.imwrite(str(out / "no_contact.png"), cv2.cvtColor(rest, cv2.COLOR_RGB2BGR))
