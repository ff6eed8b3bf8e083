"""Signatures that were used for a change: whoever saw such a request cannot send it a second time.

A signature is good for as long as the clocks may differ, before and after. So long this process remembers it. SDKs sign
each attempt anew, but nothing that they sign differs between two equal requests of one second: the id of an attempt is
not signed. Such a second one may be a retry. It is told to come later, which SDKs do by themselves, signed anew.
"""

from collections import OrderedDict
from threading import Lock

from specs.errors import AccessRefused
from tasks.gateway.signature import SKEW_S

_LIFETIME_S = 2 * SKEW_S
_MOST = 1 << 18
_SAME_SECOND_S = 2.0  # a second of the client, and one for the way here


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
                raise _sent_before(now_s - self._used[mark])
            if len(self._used) >= self._most:
                why = f"more than {self._most} changes in {_LIFETIME_S // 60} minutes; wait"
                raise AccessRefused("ThrottlingException", why, 400)
            self._used[mark] = now_s


def _sent_before(age_s: float) -> AccessRefused:
    """Returns the refusal of a signature that was used so many seconds ago."""
    why = "this request was sent before; sign it anew to send it again"
    if age_s < _SAME_SECOND_S:
        return AccessRefused("ThrottlingException", f"{why}, in another second", 400)
    return AccessRefused("InvalidSignatureException", why)
