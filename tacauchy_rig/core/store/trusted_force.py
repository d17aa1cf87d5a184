"""Which trials of a run its force sensor may be believed in, by all that was pressed with it."""

from dataclasses import dataclass, field

from tacauchy_rig.core.force_sensor_gain import (
    FORCE_HISTORY,
    FORCE_LIMITS,
    WEIGH_REMEDY,
    ForceHistory,
    judge_forces,
)
from tacauchy_rig.core.known_weight import ForceCheck
from tacauchy_rig.core.run import Criterion, TrialRecord
from tacauchy_rig.core.store.journal import Journal
from tacauchy_rig.core.store.json_codec import read_value
from tacauchy_rig.core.store.run_store import RunStore


@dataclass(slots=True, kw_only=True)
class ForceSeries:
    """The attempts of a run in the order in which they were pressed, and what is wrong with them.

    Attributes:
        doubted: Trial and attempt to what is wrong with the force sensor that measured it. All that
            was pressed before the fault was found is doubted: it may have begun earlier.
        history: Judgement of the attempts that are not.
        weighed: The check by a known weight after the last attempt; None where there was none.
        trusted: Results of the attempts that passed and are not doubted.
    """

    doubted: dict[tuple[int, int], str] = field(default_factory=dict)
    history: ForceHistory = field(default_factory=lambda: ForceHistory(trials=(), sources=()))
    weighed: ForceCheck | None = None
    trusted: dict[tuple[int, int], TrialRecord] = field(default_factory=dict)

    def take(self, record: TrialRecord) -> None:
        """Add an attempt to those that are trusted, or doubt all of them by what it found."""
        missed = [c for c in record.criteria if c.name == FORCE_HISTORY and not c.passed]
        if record.limit in FORCE_LIMITS:
            self.doubt(record.reason or record.limit)
        elif record.passed:
            self.trusted[record.index, record.attempt] = record
        elif missed:
            self.doubt(missed[0].remedy.partition(": ")[0])

    def doubt(self, reason: str) -> None:
        """Doubt all attempts that are trusted so far, unless there is no reason to."""
        if reason:
            self.doubted |= dict.fromkeys(self.trusted, reason)
            self.trusted.clear()

    def criterion(self, trial: int, attempt: int) -> Criterion | None:
        """Return what an attempt misses; None where its force is not doubted."""
        reason = self.doubted.get((trial, attempt))
        if reason is None:
            return None
        return Criterion(
            name=FORCE_HISTORY,
            passed=False,
            measured=float(self.history.excess) if self.history.fault else float("nan"),
            limit="the force sensor that measured the trial was not found faulty in or after it",
            unit="",
            remedy=f"{reason}: {WEIGH_REMEDY}",
        )


def force_series(store: RunStore) -> ForceSeries:
    """Judge the force sensor of a run by its journal and results.

    Results that are damaged are passed over, as if their attempts had been cut off.

    Raises:
        RecordError: The journal cannot be read.
    """
    series = ForceSeries()
    if store.config.is_imported:
        return series
    wrong_weight = ""
    for event in Journal.read(store.paths.journal).events:
        if event.name == "force-check":
            check = read_value(ForceCheck, event.detail, source="journal.jsonl: force-check")
            wrong_weight = "" if check.passed else f"the cell was wrong afterwards: {check.finding}"
            series.weighed = check if check.passed and series.trusted else None
        elif event.name == "attempt-start":
            series.doubt(wrong_weight)
            wrong_weight, series.weighed = "", None
            if record := store.readable_result(event.trial, event.attempt):
                series.take(record)
    series.doubt(wrong_weight)
    trusted = tuple(series.trusted.values())
    series.history = judge_forces(trusted, store.config.robot.model, weighed=series.weighed)
    series.doubt(series.history.fault)
    return series
