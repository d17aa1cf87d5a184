"""Train a force estimator on a sweep, on a CPU, and test it on held-out places and objects.

It needs torch, pyarrow and pillow: ``python force_estimator.py presses``.
"""

import io
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import torch
from PIL import Image
from torch import nn


def _read(folder: Path) -> tuple[torch.Tensor, torch.Tensor, list[dict]]:
    """Return images minus their no-contact frames, forces [N], and rows of the valid presses."""
    rows = [row for row in pq.read_table(folder / "index.parquet").to_pylist() if row["valid"]]
    images, names = [], ["image", "reference"]
    kept = {f: pq.read_table(folder / f, columns=names) for f in {row["shard"] for row in rows}}
    for row in rows:
        pair = [kept[row["shard"]][name][row["offset"]].as_py() for name in names]
        small = [Image.open(io.BytesIO(png)).resize((80, 60), Image.Resampling.BOX) for png in pair]
        images.append((np.float32(small[0]) - np.float32(small[1])) / 64.0)
    forces = [[row[f"force_{axis}_n"] for axis in "xyz"] for row in rows]
    return torch.tensor(np.stack(images)).permute(0, 3, 1, 2), torch.tensor(forces).float(), rows


def _network() -> nn.Module:
    widths = ((3, 16), (16, 32), (32, 64))
    layers = [m for w in widths for m in (nn.Conv2d(*w, 3, stride=2, padding=1), nn.ReLU())]
    return nn.Sequential(*layers, nn.Flatten(), nn.LazyLinear(64), nn.ReLU(), nn.Linear(64, 3))


def main() -> None:
    """Train once for each split."""
    images, forces, rows = _read(Path(sys.argv[1]))
    for split in ("split_place", "split_object"):
        torch.manual_seed(1)
        test = torch.tensor([row[split] == "test" for row in rows])
        network, scale = _network(), forces[~test].std(dim=0).clamp(min=1e-3)
        seen, wanted = images[~test], forces[~test] / scale
        network(seen[:1])
        descent = torch.optim.Adam(network.parameters(), lr=1e-3)
        for _ in range(40):
            for batch in torch.randperm(len(seen)).split(32):
                loss = (network(seen[batch]) - wanted[batch]).abs().mean()
                descent.zero_grad()
                loss.backward()
                descent.step()
        with torch.no_grad():
            off = (network(images[test]) * scale - forces[test]).abs().mean(dim=0)
        none = (forces[~test].median(dim=0).values - forces[test]).abs().mean(dim=0)
        print(f"{split}, {int(test.sum())} of {len(rows)} held out: mean error of x, y, z [N]")
        print(f"  {off.numpy().round(3)}; of the median: {none.numpy().round(3)}")


if __name__ == "__main__":
    main()
