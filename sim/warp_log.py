"""What Warp has to say, passed on to Python's logging; of compiled kernels with their time."""

from __future__ import annotations

import logging
import re

logger = logging.getLogger(__name__)
# Of its own, so that who wants to hear of compiled kernels need not hear the rest.
compiled = logging.getLogger(f"{__name__}.compiled")

# Of a module that was compiled; Warp says "(cached)" of one that only had to be loaded.
_COMPILED = re.compile(r"^Module (?P<name>\S+) .* took (?P<ms>[\d.]+) ms\s+\(compiled\)")


class WarpLog:
    """A logger for ``warp.set_logger``.

    A record of a compiled module goes to ``sim.warp_log.compiled``, its seconds as ``compiled_s``.
    """

    debug = staticmethod(logger.debug)
    error = staticmethod(logger.error)

    def info(self, message: str) -> None:
        """Tell of a module that was compiled; the rest is for debugging."""
        found = _COMPILED.match(message)
        if found is None:
            logger.debug("%s", message)
            return
        seconds = 1e-3 * float(found["ms"])
        compiled.info("compiled %s", found["name"], extra={"compiled_s": seconds})

    def warning(self, message: str, category: object = None, stacklevel: int = 1) -> None:
        """Pass on a warning."""
        del category
        logger.warning("%s", message, stacklevel=stacklevel + 1)
