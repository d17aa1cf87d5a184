"""The page's process: hears the feeds and the supervisor, serves the page, and can only stop."""

from __future__ import annotations

import asyncio
import logging
import socket
import sys

from protocols.processes.channel import Channel
from protocols.processes.child import ignore_signals, run_child
from protocols.processes.feed import FeedReader
from protocols.processes.messages import AbortRequest, Job, Order
from protocols.processes.page.door import Door
from protocols.processes.page.server import PageServer
from protocols.processes.page.view import View
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.run import JournalEvent

logger = logging.getLogger(__name__)

ALIVE_S = 0.5
LAST_WORDS_S = 0.4
SOURCES = ("control", "camera", "twin")


def serve(job: Job, supervisor: Channel) -> None:
    """Do the page's job.

    Raises:
        ConfigError: The job is none of a page.
    """
    ignore_signals()
    if job.page is None:
        raise ConfigError("page: started without what it has to know")
    listener = socket.socket(fileno=job.descriptors["listen"])
    door = Door(job.page.token, port=listener.getsockname()[1])
    readers = [FeedReader.inherited(job.descriptors, source=source) for source in SOURCES]
    feeds = [reader for reader in readers if reader is not None]
    asyncio.run(_serve(View(job), feeds, supervisor, listener, door))


async def _serve(
    view: View,
    feeds: list[FeedReader],
    supervisor: Channel,
    listener: socket.socket,
    door: Door,
) -> None:
    ended = asyncio.Event()
    loop = asyncio.get_running_loop()

    def stop() -> bool:
        return supervisor.send(AbortRequest(reason="stop was pressed on the page"))

    def hear(feed: FeedReader) -> None:
        for shown in feed.receive():
            view.take(shown)
        view.dropped_count = sum(each.lost_count for each in feeds)

    def obey() -> None:
        for message in supervisor.receive():
            if isinstance(message, JournalEvent):
                view.note(message)
            elif message is Order.STOP:
                ended.set()
        if supervisor.closed:
            loop.remove_reader(supervisor.fileno())
            ended.set()

    for feed in feeds:
        loop.add_reader(feed.fileno(), hear, feed)
    loop.add_reader(supervisor.fileno(), obey)
    server = PageServer(view, door, stop=stop)
    serving = asyncio.create_task(server.serve(listener))
    while not ended.is_set() and not serving.done():
        supervisor.send(Order.ALIVE)
        view.look_at_disk()
        await _either(ended, serving)
    await asyncio.sleep(LAST_WORDS_S)  # for the last event to reach the browsers
    server.end()
    await serving


async def _either(ended: asyncio.Event, serving: asyncio.Task[None]) -> None:
    waiting = asyncio.create_task(ended.wait())
    await asyncio.wait({waiting, serving}, timeout=ALIVE_S, return_when=asyncio.FIRST_COMPLETED)
    waiting.cancel()


if __name__ == "__main__":
    sys.exit(run_child("page", serve))
