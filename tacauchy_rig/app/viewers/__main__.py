"""The process that publishes a run: no other process waits for it, and it takes no requests."""

from __future__ import annotations

import logging
import os
import select
import sys
import time

import foxglove

from protocols.processes.child import ignore_signals, run_child
from protocols.processes.messages import Channel, Job, Order, feed_readers
from protocols.processes.viewing import LOOPBACK, PRODUCERS
from tacauchy_rig.app.viewers.options import PORT, SOURCES, address
from tacauchy_rig.app.viewers.topics import Topics
from tacauchy_rig.core.run import JournalEvent

logger = logging.getLogger(__name__)

NICENESS = 10
ALIVE_S = 0.5


def publish(job: Job, supervisor: Channel) -> None:
    """Do the job."""
    ignore_signals()
    os.nice(NICENESS)
    port = int(job.options[PORT])
    # Without capabilities and services a viewer can neither publish, nor set, nor call anything.
    server = foxglove.start_server(
        name="tacauchy-rig", host=LOOPBACK, port=port, capabilities=[], services=[]
    )
    logger.info("publishing at %s", address(port))
    topics = Topics(job.plan)
    readers = feed_readers(job.descriptors, (*PRODUCERS, *SOURCES))
    waiting = [supervisor.fileno(), *(reader.fileno() for reader in readers)]
    told_s = 0.0
    try:
        while not supervisor.closed:
            if time.monotonic() - told_s > ALIVE_S:
                told_s = time.monotonic()
                supervisor.send(Order.ALIVE)
            select.select(waiting, [], [], ALIVE_S)
            for reader in readers:
                for shown in reader.receive():
                    topics.show(shown)
            for message in supervisor.receive():
                if message is Order.STOP:
                    return
                if isinstance(message, JournalEvent):
                    topics.note(message)
    finally:
        server.stop()


if __name__ == "__main__":
    sys.exit(run_child("foxglove", publish))
