"""A browser's session: a cookie that only who knows the key's secret can make, good for some hours.

Who guesses secrets is slowed down: after a few that were wrong, an address has to wait, longer each time.
"""

import base64
import binascii
import hashlib
import hmac
import re
import secrets
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie

LIFE_S = 8 * 3600
_PURPOSE = b"simyard page session 1\n"
_MOST_CHARACTERS = 1024
_MOST_ENDED = 10_000
_BODY = re.compile(rb"([A-Za-z0-9._-]{1,128})\|([0-9]{1,12})\|([0-9a-f]{32})")
SecretOf = Callable[[str], str | None]


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
    body = f"{session.key_id}|{session.ends_at_s}|{session.number}".encode()
    return f"{_text(body)}.{_text(_mac(secret, body))}"


def open_session(value: str, secret_of: SecretOf, now_s: float) -> Session | None:
    """Returns the session of a cookie; None if it was not made with the key's secret, or is over.

    Args:
        value: Of the cookie.
        secret_of: Returns the secret of a key; None for a key that is not known.
        now_s: The time, seconds since 1970.
    """
    body, mac = _parts(value)
    session = _decoded(body)
    if session is None:
        return None
    secret = secret_of(session.key_id)
    expected = _mac(secret or secrets.token_hex(16), body)
    is_good = hmac.compare_digest(mac, expected) and secret is not None
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
    secure = "; Secure" if is_secure else ""
    return f"{name}={value}; Path=/; Max-Age={life_s}; HttpOnly; SameSite=Strict{secure}"


def cookie_value(header: str, name: str) -> str:
    """Returns what a cookie of a request holds; empty if it is not there."""
    try:
        found = SimpleCookie(header[:8192]).get(name)
    except CookieError:
        return ""
    return found.value if found else ""


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


def _mac(secret: str, body: bytes) -> bytes:
    key = hmac.digest(secret.encode(), _PURPOSE, "sha256")
    return hmac.digest(key, body, "sha256")


def _text(data: bytes) -> str:
    return base64.urlsafe_b64encode(data).decode().rstrip("=")


def _parts(value: str) -> tuple[bytes, bytes]:
    """Returns what stands in a cookie and what vouches for it; empty bytes for what is no such text."""
    body, dot, mac = value.partition(".")
    if not dot or len(value) > _MOST_CHARACTERS or not value.isascii():
        return b"", b""
    try:
        return _bytes(body), _bytes(mac)
    except binascii.Error:
        return b"", b""


def _bytes(text: str) -> bytes:
    return base64.b64decode(text + "=" * (-len(text) % 4), altchars=b"-_", validate=True)


def _decoded(body: bytes) -> Session | None:
    found = _BODY.fullmatch(body)
    return Session(found[1].decode(), int(found[2]), found[3].decode()) if found else None


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
