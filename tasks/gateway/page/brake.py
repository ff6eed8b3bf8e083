"""Slows down who guesses secrets: after a few that were wrong, an address has to wait, longer each time."""

import threading
from collections import OrderedDict
from dataclasses import dataclass, field

_FREE = 5
_FIRST_S, _LONGEST_S = 2.0, 300.0
_FORGOTTEN_S = 900.0
_MOST_ADDRESSES = 4096


@dataclass(frozen=True)
class _Mistakes:
    """How often an address was wrong, and when it was last."""

    count: int
    last_s: float


@dataclass
class SignInBrake:
    """The mistakes of addresses; many threads may ask at once.

    The addresses that were wrong least lately are forgotten when there are thousands.
    """

    _known: OrderedDict[str, _Mistakes] = field(default_factory=OrderedDict[str, _Mistakes])
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def begin(self, address: str, now_s: float) -> float:
        """Returns how long an address must wait before it may try; 0 if it may try now.

        A try counts as a mistake until it is forgiven, so that many at once are no way around. Mistakes of a quarter
        of an hour ago do not count.
        """
        with self._lock:
            known = self._known.pop(address, _Mistakes(0, now_s))
            count = 0 if now_s - known.last_s > _FORGOTTEN_S else known.count
            wait_s = known.last_s + _pause_s(count) - now_s
            self._known[address] = known if wait_s > 0 else _Mistakes(count + 1, now_s)
            if len(self._known) > _MOST_ADDRESSES:
                self._known.popitem(last=False)
        return max(0.0, wait_s)

    def forgive(self, address: str) -> None:
        """Forgets the mistakes of an address that has the right secret."""
        with self._lock:
            self._known.pop(address, None)


def _pause_s(count: int) -> float:
    return min(_FIRST_S * 2 ** min(count - _FREE, 16), _LONGEST_S) if count >= _FREE else 0.0
