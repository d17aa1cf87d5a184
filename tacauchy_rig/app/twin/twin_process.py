"""The twin's process: it follows a run at the lowest priority, and no process waits for it."""

import logging
import os
import select
import sys
import threading
import time

from protocols.processes.child_process import PRODUCERS, ignore_signals, run_child
from protocols.processes.ipc import VIEWERS, Channel, FeedWriters, Job, Order, feed_readers
from tacauchy_rig.app.twin.run_follower import DEVICE, FOLLOWS, Follows, RunFollower, twin_of
from tacauchy_rig.core.run import JournalEvent
from tacauchy_rig.core.store.json_codec import dumps

logger = logging.getLogger(__name__)

NICENESS = 19
ALIVE_S = 1.0
LOOK_S = 0.1
HUNG_S = 120.0


def follow_run(job: Job, supervisor: Channel) -> None:
    """Do the twin's job."""
    ignore_signals()
    os.nice(NICENESS)
    beaten_s = time.monotonic()

    def tell() -> None:
        """Tell the supervisor that this process lives, while it gets on with its work."""
        while not supervisor.closed and time.monotonic() - beaten_s < HUNG_S:
            supervisor.send(Order.ALIVE)
            time.sleep(ALIVE_S)

    threading.Thread(target=tell, name="pulse", daemon=True).start()
    twin = twin_of(job.config, device=job.options[DEVICE])
    logger.info("ready; its force error: %s", twin.follower.stated_error.basis)
    following = RunFollower(twin, Follows(job.options[FOLLOWS]))
    readers = feed_readers(job.descriptors, PRODUCERS)
    writers = FeedWriters(job.descriptors, VIEWERS)
    waiting = [supervisor.fileno(), *(reader.fileno() for reader in readers)]
    while not supervisor.closed:
        beaten_s = time.monotonic()
        select.select(waiting, [], [], LOOK_S)
        for reader in readers:
            for shown in reader.receive():
                following.take(shown)
        for message in supervisor.receive():
            if message is Order.STOP:
                return
            if isinstance(message, JournalEvent):
                following.note(message)
        made = following.step()
        if made is None:
            continue
        line, pictures = made
        for shown in pictures:
            writers.show(shown.stream, shown.stamp_ns, shown.numbers, shown.picture)
        try:  # nothing depends on these lines
            with (job.root / "twin.jsonl").open("ab") as log:
                log.write(dumps(line, indent=None))
        except OSError as error:
            logger.error("a line of twin.jsonl is lost: %s", error.strerror)


if __name__ == "__main__":
    sys.exit(run_child("twin", follow_run))
