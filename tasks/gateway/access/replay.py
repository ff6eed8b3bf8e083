"""Signatures that were used for a change: whoever saw such a request cannot send it a second time.

A signature is good for as long as the clocks may differ, before and after. So long this process remembers it. A client
that repeats a request within the second in which it signed it, or two that ask for the same at once, make the same
signature: botocore signs neither the id nor the number of an attempt. They are asked to come again, as SDKs do by
themselves, with a signature of another second.
"""

from collections import OrderedDict
from threading import Lock

from specs.errors import AccessRefused
from tasks.gateway.signature import SKEW_S

_LIFETIME_S = 2 * SKEW_S
_MOST = 1 << 18


class UsedSignatures:
    """The signatures of the last minutes; several threads may ask."""

    def __init__(self, most: int = _MOST) -> None:
        """Remembers nothing yet.

        Args:
            most: How many are remembered; one takes some 200 bytes.
        """
        self._most = most
        self._lock = Lock()
        self._used: OrderedDict[bytes, float] = OrderedDict()

    def use(self, signature: str, now_s: float) -> None:
        """Remembers a signature that was checked.

        Args:
            signature: In hexadecimal digits.
            now_s: Seconds by a clock that is never set back.

        Raises:
            AccessRefused: It was used before, or so many are remembered that this one could not be.
        """
        mark = bytes.fromhex(signature)
        with self._lock:
            while self._used and now_s - next(iter(self._used.values())) > _LIFETIME_S:
                self._used.popitem(last=False)
            if mark in self._used:
                why = "this request was sent before; sign it anew, in another second, to send it again"
                raise AccessRefused("ThrottlingException", why, 400)
            if len(self._used) >= self._most:
                why = f"more than {self._most} changes in {_LIFETIME_S // 60} minutes; wait"
                raise AccessRefused("ThrottlingException", why, 400)
            self._used[mark] = now_s
