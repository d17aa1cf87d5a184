"""What control shows its viewers of force and arm, beside the record."""

from __future__ import annotations

from protocols.control.cycle import Cycle
from protocols.control.record import Arm, Entry, Force, Sink
from protocols.processes.feed import FeedWriters
from tacauchy_rig.core.run import ArmSample, ForceSample

PERIOD_NS = 25_000_000
PENDING_MAX = 1000


class Broadcast:
    """A ``Sink`` that hands everything on and, forty times a second, shows what passed.

    Args:
        sink: Keeps the record.
        feeds: Lead to the viewers.
    """

    def __init__(self, sink: Sink, feeds: FeedWriters) -> None:
        self._sink = sink
        self._feeds = feeds
        self._force: list[ForceSample] = []
        self._arm: list[ArmSample] = []
        self._shown_ns = 0

    def put(self, entry: Entry) -> None:
        """Hand an entry on, and remember what is to be shown of it."""
        self._sink.put(entry)
        if not self._feeds:
            return
        match entry:
            case Force(samples=samples):
                self._force = [*self._force, *samples][-PENDING_MAX:]
            case Arm(samples=samples):
                self._arm = [*self._arm, *samples][-PENDING_MAX:]
            case _:
                pass

    def problem(self) -> str:
        """Return what the record's own keeper says."""
        return self._sink.problem()

    def lag_s(self) -> float:
        """Return how far the record's keeper is behind [s]."""
        return self._sink.lag_s()

    def show(self, cycle: Cycle) -> None:
        """Show what passed since the last time, if it is time."""
        now_ns = cycle.rig.clock.now_ns()
        if not self._feeds or now_ns - self._shown_ns < PERIOD_NS:
            return
        self._shown_ns = now_ns
        if self._force:
            wrenches = [cycle.force_guard.tared(sample) for sample in self._force]
            numbers = {
                "stamp_ns": [sample.stamp_ns for sample in self._force],
                "counter": [sample.counter for sample in self._force],
                "force_n": [cycle.force_guard.pressing(wrench) for wrench in wrenches],
                "wrench": wrenches[-1],
                "is_tared": cycle.force_guard.is_tared,
                "record_lag_s": self._sink.lag_s(),
            }
            self._feeds.show("force", self._force[-1].stamp_ns, numbers)
            self._force = []
        if self._arm:
            newest = self._arm[-1]
            numbers = {
                "count": len(self._arm),
                "position_m": newest.pose.position,
                "rotation_rad": newest.pose.rotation_vector,
                "velocity": newest.velocity,
                "safety_bits": newest.safety_bits,
            }
            self._feeds.show("arm", newest.stamp_ns, numbers)
            self._arm = []
