"""Doctor's look at the computer: clock, timer, cores, memory, groups, versions and disk."""

import resource
from pathlib import Path

import pytest

from tacauchy_rig.app.host_checks import (
    core_check,
    descriptor_check,
    disk_checks,
    group_checks,
    host_checks,
    measure_disk,
    memory_check,
    version_check,
)
from tacauchy_rig.core.config.load import load_config
from tacauchy_rig.core.config.settings import RigConfig
from tacauchy_rig.core.doctor_check import CheckStatus
from tacauchy_rig.core.errors import RecordError


def configured(*overrides: str) -> RigConfig:
    """Return the defaults with ``table.field=value`` overrides."""
    return load_config(overrides=overrides).config


def test_every_check_answers(tmp_path: Path) -> None:
    """All checks run on this computer; whatever is not ok says what to do."""
    results = host_checks(configured(f"run.output_directory={tmp_path}"))
    names = [result.name for result in results]
    assert len(set(names)) == len(names)
    assert {"host.timer", "host.memory", "disk.space", "disk.rate"} <= set(names)
    for result in results:
        assert result.finding
        assert bool(result.remedy) == (result.status in (CheckStatus.WARN, CheckStatus.FAIL))


def test_missing_package_fails() -> None:
    """A package that is not installed is named."""
    result = version_check(("numpy", "no-such-package"))
    assert result.status is CheckStatus.FAIL
    assert "missing: no-such-package" in result.finding


def test_a_run_that_could_open_too_few_files_fails() -> None:
    """The limit and what lifts it are named; no limit is none."""
    few = descriptor_check(24)
    assert few.status is CheckStatus.FAIL
    assert few.finding == "only 24 files may be open at once; a run needs 64"
    assert "ulimit -n" in few.remedy
    assert descriptor_check(1024).status is CheckStatus.OK
    assert descriptor_check(resource.RLIM_INFINITY).status is CheckStatus.OK


def test_small_computers_are_warned_of() -> None:
    """One core or little memory is told, two cores and 4 GiB are enough."""
    assert core_check(1).status is CheckStatus.WARN
    assert core_check(2).status is CheckStatus.OK
    assert memory_check(2**30).status is CheckStatus.WARN
    assert memory_check(4 * 2**30).status is CheckStatus.OK


def test_groups_matter_for_real_devices_only() -> None:
    """The groups are asked for where a real device needs them, and not of root."""
    emulated = configured()
    real = configured(
        "force_sensor.driver=m3733c",
        "force_sensor.port=/dev/ttyUSB0",
        "force_sensor.calibration_sheet=test",
        "force_sensor.capacity=50 N",
    )
    skipped, _ = group_checks(emulated, groups=frozenset(), user_id=1000)
    assert skipped.status is CheckStatus.SKIP
    outside, camera = group_checks(real, groups=frozenset({"users"}), user_id=1000)
    assert outside.status is CheckStatus.WARN
    assert "usermod -aG dialout" in outside.remedy
    assert camera.status is CheckStatus.SKIP
    inside, _ = group_checks(real, groups=frozenset({"dialout"}), user_id=1000)
    root, _ = group_checks(real, groups=frozenset(), user_id=0)
    assert inside.status is root.status is CheckStatus.OK


def test_disk_rate_is_measured_and_leaves_nothing(tmp_path: Path) -> None:
    """Writing is measured where the runs will go, also before the folder exists."""
    assert min(measure_disk(tmp_path / "runs" / "later", duration_s=0.1)) > 0
    assert list(tmp_path.iterdir()) == []


def test_disk_that_cannot_keep_up_fails(tmp_path: Path) -> None:
    """A stream beyond any disk is refused, and too little space as well."""
    config = configured(
        f"run.output_directory={tmp_path}",
        "camera.width=8192",
        "camera.height=8192",
        "camera.rate=240 fps",
    )
    by_name = {result.name: result for result in disk_checks(config)}
    assert by_name["disk.rate"].status is CheckStatus.FAIL
    assert "faster disk" in by_name["disk.rate"].remedy


def test_unwritable_place_is_named() -> None:
    """A place where nothing can be written says so."""
    with pytest.raises(RecordError, match="/proc: cannot be written"):
        measure_disk(Path("/proc/runs"))
