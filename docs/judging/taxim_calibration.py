"""Say how far Taxim's own renderer, with an exported calibration, is from our images of presses.

It runs in the environment of ``taxim_presses.py`` on the folders of these commands:

    tacauchy-rig export gelsight-mini exported --to taxim
    tacauchy-rig press --sensor gelsight-mini --indenter ... --out pressed

    taxim-venv/bin/python docs/judging/taxim_calibration.py exported pressed ...

Taxim gets our deformed surface and does not smooth it, so that only the colours differ. Its change
against its own image of the unloaded gel is compared, where the colour changes and no marker is.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.ndimage import binary_dilation
from taxim import Taxim

SHARP = {"deform_pyramid_sigma_rel": [[1e-3], [1e-3]], "deform_final_sigma_rel": [1e-3, 1e-3]}
CHANGED, MARKER = 3.0, 40.0
"""Grey levels by which a pixel changes at least; by which a marker is darker than its frame."""


def main() -> None:
    """Print a row for each press, of a table in Markdown."""
    exported = Path(sys.argv[1])
    taxim = Taxim(exported, params={"simulator": SHARP}, backend="jax", device="cpu")
    with np.load(exported / "dataPack.npz", allow_pickle=False) as data:
        frame = data["f0"][..., ::-1].astype(float)
    sys.stdout.write(
        "| press | pixels that change | by [levels] | apart, mean | 95 % below | correlation |\n"
        "|---|---|---|---|---|---|\n"
    )
    for pressed in map(Path, sys.argv[2:]):
        with np.load(pressed / "height.npz", allow_pickle=False) as height:
            highest_m = max(height["rest_m"].max(), height["loaded_m"].max())
            surfaces = [1e3 * (height[name] - highest_m) for name in ("rest_m", "loaded_m")]
        rest, loaded = (255.0 * np.asarray(taxim.render(s, with_shadow=False)) for s in surfaces)
        ours = np.asarray(Image.open(pressed / "image.png").convert("RGB")).astype(float) - frame
        theirs = np.clip(frame + loaded - rest, 0.0, 255.0) - frame
        marker = binary_dilation((ours < -MARKER).all(axis=2), iterations=6)
        changed = (np.maximum(abs(ours), abs(theirs)).max(axis=2) > CHANGED) & ~marker
        apart = abs(ours - theirs)[changed]
        alike = np.corrcoef(ours[changed].ravel(), theirs[changed].ravel())[0, 1]
        sys.stdout.write(
            f"| {pressed.name} | {changed.mean():.1%} | {abs(ours[changed]).mean():.1f} "
            f"| {apart.mean():.2f} | {np.percentile(apart, 95):.1f} | {alike:.4f} |\n"
        )


if __name__ == "__main__":
    main()
