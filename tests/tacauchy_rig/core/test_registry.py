"""Everything of ours can be imported, and what another package gets wrong is told with its name."""

from __future__ import annotations

from pathlib import Path

import pytest

from sim.scene.material import LawName
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.registry import Kind, load, names, unknown


def install(folder: Path, package: str, entries: str) -> None:
    """Put the metadata of a package into a folder of packages."""
    metadata = folder / f"{package.replace('-', '_')}-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(entries)


@pytest.mark.parametrize("kind", list(Kind))
def test_all_of_ours_import(kind: Kind) -> None:
    """No line of the table points nowhere."""
    assert names(kind)
    for name in names(kind):
        assert load(kind, name) is not None


def test_every_law_is_registered_by_its_own_name() -> None:
    """The names that sim knows are those of the registry, and each law says its own."""
    assert [name for name in names(Kind.LAW) if name in set(LawName)] == list(LawName)
    assert all(load(Kind.LAW, name).name == name for name in LawName)


def test_every_sensor_file_is_registered() -> None:
    """A file that nobody lists could not be found by name."""
    files = {load(Kind.SENSOR, name) for name in names(Kind.SENSOR)}
    assert files == set(next(iter(files)).parent.glob("*.toml"))


def test_an_unknown_name_is_answered_with_what_there_is() -> None:
    """The kind, the names, and where more would come from."""
    with pytest.raises(ConfigError, match='force sensor "ati" is none of "m3733c"') as caught:
        load(Kind.FORCE_SENSOR, "ati")
    assert "tacauchy_rig.force_sensors" in caught.value.remedy
    assert unknown(Kind.ARM, "ur5") == ""


def test_a_package_that_does_not_import_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever its code raises; and its name is still listed."""
    install(tmp_path, "broken-lab", "[tacauchy_rig.arms]\nfranka = broken_lab.arm:Franka\n")
    (tmp_path / "broken_lab").mkdir()
    (tmp_path / "broken_lab" / "arm.py").write_text("raise OSError('no libfranka')\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert names(Kind.ARM)[-1] == "franka"
    with pytest.raises(
        ConfigError, match=r'arm "franka" of the package broken-lab 1\.0 .* OSError: no libfranka'
    ):
        load(Kind.ARM, "franka")


def test_a_name_brought_twice_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Which of two packages is meant cannot be guessed."""
    install(tmp_path, "lab-a", "[tacauchy_rig.laws]\nogden = lab_a:LAW\n")
    install(tmp_path, "lab-b", "[tacauchy_rig.laws]\nogden = lab_b:LAW\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ConfigError, match=r'"ogden" is brought by both lab-. 1\.0 and lab-. 1\.0'):
        names(Kind.LAW)


def test_ours_cannot_be_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package that brings another ``ur5`` does not change which arm moves."""
    install(tmp_path, "lab-a", "[tacauchy_rig.arms]\nur5 = lab_a:Arm\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert load(Kind.ARM, "ur5").__module__ == "drivers.arm.ur5"
