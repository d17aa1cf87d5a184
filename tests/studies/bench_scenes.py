"""The benchmark's scenes for studies that press them otherwise."""

from collections.abc import Sequence

from sim.studies.bench.scenes import Scenes, all_scenes, drawn_scenes
from tacauchy_rig.core.study import selected


def select_scenes(patterns: Sequence[str], *, drawn: int | None = None) -> Scenes:
    """Return the scenes whose name has one of the patterns in it, such as ``ball``; else all.

    With a seed they are chosen among drawn ones.

    Raises:
        ConfigError: None has one of them.
    """
    scenes = all_scenes() if drawn is None else drawn_scenes(drawn)
    parts = [f"*{pattern}*" for pattern in patterns]
    names = selected(list(scenes), parts, names=lambda name: (name,), kind="scene")
    return {name: scenes[name] for name in names}
