"""Renders contacts beside the camera's schedule, so that a slow one delays no frame."""

from __future__ import annotations

import threading

from drivers.emulators.camera.frames import FrameFactory, PressKey


class BackgroundRenderer:
    """One thread that always works on the newest wish."""

    def __init__(self, factory: FrameFactory) -> None:
        self._factory = factory
        self._changed = threading.Condition()
        self._wanted: PressKey | None = None
        self._asked_count = 0
        self._done_count = 0
        self._open = True
        self._thread = threading.Thread(target=self._work, name="renderer", daemon=True)
        self._thread.start()

    def ask(self, key: PressKey, *, timeout_s: float) -> bool:
        """Ask for ``key`` and wait for it at most ``timeout_s`` [s]; False when it is not ready."""
        with self._changed:
            self._wanted = key
            self._asked_count += 1
            mine = self._asked_count
            self._changed.notify_all()
            return self._changed.wait_for(lambda: self._done_count >= mine, max(0.0, timeout_s))

    def close(self) -> None:
        """End the thread."""
        with self._changed:
            self._open = False
            self._changed.notify_all()
        self._thread.join()

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._wanted is not None or not self._open)
                if not self._open:
                    return
                key, self._wanted = self._wanted, None
                count = self._asked_count
            if key is not None:
                self._factory.prepare(key)
            with self._changed:
                self._done_count = count
                self._changed.notify_all()
