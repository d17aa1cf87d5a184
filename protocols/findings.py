"""What is known of an attempt so far; a fault in the middle keeps all of it."""

from __future__ import annotations

from dataclasses import dataclass

from protocols.steps.dwell import Dwell
from protocols.steps.reference import ReferenceWindow
from tacauchy_rig.run import Criterion, Outcome, Tare, TrialRecord, TrialSpec


@dataclass(slots=True, kw_only=True)
class Findings:
    """Filled step by step."""

    spec: TrialSpec
    attempt: int
    tare_before: Tare | None = None
    tare_after: Tare | None = None
    reference: ReferenceWindow | None = None
    contact_z_m: float | None = None
    dwell: Dwell | None = None
    drift_n: float | None = None

    def record(
        self,
        outcome: Outcome,
        *,
        rates: dict[str, float],
        reason: str = "",
        criteria: tuple[Criterion, ...] = (),
    ) -> TrialRecord:
        """Return the record of the attempt."""
        dwell, reference = self.dwell, self.reference
        return TrialRecord(
            index=self.spec.index,
            attempt=self.attempt,
            outcome=outcome,
            force_target_n=self.spec.force_target_n,
            reason=reason,
            force_measured_n=dwell.force.mean_n if dwell else None,
            force_deviation_n=dwell.force.deviation_n if dwell else None,
            force_rate_n_s=dwell.force.slope_n_s if dwell else None,
            force_drift_n=self.drift_n,
            contact_z_m=self.contact_z_m,
            depth_measured_m=dwell.depth_m if dwell else None,
            tare_before=self.tare_before,
            tare_after=self.tare_after,
            dwell_start_ns=dwell.force.start_ns if dwell else None,
            dwell_end_ns=dwell.force.end_ns if dwell else None,
            reference_start_ns=reference.start_ns if reference else None,
            reference_end_ns=reference.end_ns if reference else None,
            criteria=criteria,
            rates=rates,
        )
