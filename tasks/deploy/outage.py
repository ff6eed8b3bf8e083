"""What the log says while the store is away: that it went, that it is still away, and that it is back."""

import logging
import time

_LOG = logging.getLogger(__name__)
_AGAIN_S = 600.0


class Outage:
    """Told of every attempt, it logs few of them: an agent tries for days, several times a minute.

    Args:
        what: What cannot be done, such as ``report``.
    """

    def __init__(self, what: str) -> None:
        self._what = what
        self._kind: type[Exception] | None = None
        self._since_s = 0.0
        self._told_s = 0.0

    def failed(self, exc: Exception) -> None:
        """Logs the first failure, one of another kind, and one every ten minutes."""
        now_s = time.monotonic()
        if self._kind is None:
            self._since_s = now_s
        if self._kind is not type(exc) or now_s - self._told_s >= _AGAIN_S:
            _LOG.warning("cannot %s: %s", self._what, exc)
            self._told_s = now_s
        self._kind = type(exc)

    def worked(self) -> None:
        """Logs that it is over, if there was a failure."""
        if self._kind is not None:
            _LOG.warning("can %s again after %.0f s", self._what, time.monotonic() - self._since_s)
        self._kind = None
