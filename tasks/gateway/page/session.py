"""A browser's session: a cookie that only who knows the key's secret can make, good for some hours.

Nothing is stored for it. What it is signed with is made from the secret of the key that signed in, so that every
gateway of a store knows it, and it ends with the key. Who guesses secrets is slowed down: after a few that were wrong,
an address has to wait, longer each time.
"""

import hashlib
import hmac
import re
import secrets
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field

from itsdangerous import Signer
from starlette.requests import cookie_parser
from starlette.responses import Response

LIFE_S = 8 * 3600
_PURPOSE = b"simyard page session 1"
_MOST_CHARACTERS = 1024
_MOST_ENDED = 10_000
_BODY = re.compile(r"([A-Za-z0-9._-]{1,128})\|([0-9]{1,12})\|([0-9a-f]{32})\.[A-Za-z0-9_-]+\Z", re.ASCII)
SecretOf = Callable[[str], str | None]
_FREE = 5
_FIRST_S, _LONGEST_S = 2.0, 300.0
_FORGOTTEN_S = 900.0
_MOST_ADDRESSES = 4096


@dataclass(frozen=True)
class Session:
    """Who has signed in, and until when.

    Attributes:
        key_id: The access key's id.
        ends_at_s: Seconds since 1970.
        number: Random, to tell it from others.
    """

    key_id: str
    ends_at_s: int
    number: str


def new_session(key_id: str, now_s: float) -> Session:
    """Returns a session that begins now."""
    return Session(key_id, int(now_s) + LIFE_S, secrets.token_hex(16))


def seal_session(session: Session, secret: str) -> str:
    """Returns the value of the cookie."""
    return _signer(secret).sign(f"{session.key_id}|{session.ends_at_s}|{session.number}").decode()


def open_session(value: str, secret_of: SecretOf, now_s: float) -> Session | None:
    """Returns the session of a cookie; None if it was not made with the key's secret, or is over.

    Args:
        value: Of the cookie.
        secret_of: Returns the secret of a key; None for a key that is not known.
        now_s: The time, seconds since 1970.
    """
    said = _BODY.match(value) if len(value) <= _MOST_CHARACTERS else None
    if said is None:
        return None
    session = Session(said[1], int(said[2]), said[3])
    secret = secret_of(session.key_id)
    is_good = _signer(secret or secrets.token_hex(16)).validate(value) and secret is not None
    # A life that is longer than any that was given is none, whatever the clock was.
    return session if is_good and 0 <= session.ends_at_s - now_s <= LIFE_S else None


def matches(secret: str | None, given: str) -> bool:
    """Returns whether a secret that was typed in is the key's, in a time that tells nothing about it."""
    known = hashlib.sha256((secret or secrets.token_hex(16)).encode()).digest()
    return hmac.compare_digest(known, hashlib.sha256(given.encode()).digest()) and bool(secret)


def cookie_name(port: str, *, is_secure: bool) -> str:
    """Returns the name of the cookie: cookies do not tell ports apart, so that its name does."""
    return "__Host-simyard" if is_secure else f"simyard-{port}"


def cookie_header(name: str, value: str, life_s: int, *, is_secure: bool) -> str:
    """Returns the header Set-Cookie; a life of 0 removes the cookie."""
    answer = Response()
    answer.set_cookie(name, value, max_age=life_s, secure=is_secure, httponly=True, samesite="strict")
    return answer.headers["set-cookie"]


def cookie_value(header: str, name: str) -> str:
    """Returns what a cookie of a request holds; empty if it is not there."""
    return cookie_parser(header[:8192]).get(name, "")


@dataclass
class EndedSessions:
    """The sessions that were left before their time: their cookies are refused by this process.

    The oldest are forgotten when there are thousands; who can make that many has a key.
    """

    _ends: dict[str, int] = field(default_factory=dict[str, int])
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def end(self, session: Session) -> None:
        """Ends a session."""
        with self._lock:
            self._ends[session.number] = session.ends_at_s
            if len(self._ends) > _MOST_ENDED:
                del self._ends[next(iter(self._ends))]

    def __contains__(self, session: Session) -> bool:
        """Returns whether a session was ended."""
        return session.number in self._ends


def _signer(secret: str) -> Signer:
    return Signer(secret, salt=_PURPOSE, key_derivation="hmac", digest_method=hashlib.sha256)


@dataclass(frozen=True)
class _Mistakes:
    """How often an address was wrong, and when it was last."""

    count: int
    last_s: float


@dataclass
class LoginRateLimit:
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
