"""Who gets in: with signatures, or without them on this machine's own address.

Requests that a page of another site makes a browser send are refused.
"""

import logging
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from ipaddress import ip_address
from typing import Protocol

from specs.arn import parse_reference
from specs.base import Spec
from specs.errors import AccessRefused, DocumentError
from specs.robomaker.operations import Operation
from tasks.gateway.access.access_keys import AccessKey, KeyFile
from tasks.gateway.access.rights import FleetOf, check_right, is_within
from tasks.gateway.access.signature import UsedSignatures, check_signature, claim_of, unknown_key
from tasks.gateway.rest_json import HttpAnswer, HttpRequest, error_answer

_OWN_SITES = frozenset({"same-origin", "none"})
_NAMES = frozenset({"localhost", "127.0.0.1", "[::1]"})
_LOG = logging.getLogger(__name__)
_KEYS_AWAY = "the access keys cannot be read; the log of simyard serve says more"


@dataclass(frozen=True)
class Caller:
    """Who asks.

    Attributes:
        key: The id of the key that the request is signed with; empty where nobody signs.
        name: The key's.
    """

    key: str = ""
    name: str = ""


@dataclass(frozen=True)
class Call:
    """A request that was answered.

    Attributes:
        request: As it came.
        answer: As it was sent.
        duration_s: From the whole request to the answer.
        caller: None if the guard did not let it in.
        operation: None if it was for none.
        document: The request's members as a document, with ARNs in Simyard's own form; None if it was refused before.
    """

    request: HttpRequest
    answer: HttpAnswer
    duration_s: float
    caller: Caller | None = None
    operation: Operation | None = None
    document: Spec | None = None


class Guard(Protocol):
    """Decides about each request; called from several threads at once."""

    def refuse_head(self, request: HttpRequest, operation: Operation | None) -> HttpAnswer | None:
        """Returns the refusal of a request whose body need not be read; called from the thread that serves all.

        Args:
            request: Without its body.
            operation: As for ``admit``.
        """
        ...

    def admit(self, request: HttpRequest, operation: Operation | None) -> Caller | HttpAnswer:
        """Returns who asks, or the refusal; asked once the body is there, before anything is done with it.

        Args:
            request: As it came.
            operation: What it is for; None for a page of the browser, and for what is unknown.
        """
        ...

    def permit(self, caller: Caller, operation: Operation, document: Spec) -> HttpAnswer | None:
        """Returns the refusal if this caller may not do it; None lets the operation go on.

        Args:
            caller: Whom ``admit`` let in.
            operation: What is asked for.
            document: The request, checked, with ARNs in Simyard's own form.
        """
        ...


Note = Callable[[Call], None]
"""Keeps a line about a call before it is answered; called from several threads at once."""


def no_note(_call: Call) -> None:
    """Keeps nothing."""


# A browser says which page asks (``Origin``, ``Sec-Fetch-Site``) and by which name it found this address (``Host``).
# A name of an attacker's may lead here (DNS rebinding). Programs send neither Origin nor Sec-Fetch-Site. A browser
# sends Origin with every POST and DELETE, forms among them, so the type of a body need not be looked at.
def loopback_hosts(port: int) -> frozenset[str]:
    """Returns what programs of this machine call a port of it."""
    return frozenset({f"{name}:{port}" for name in _NAMES} | (_NAMES if port in {80, 443} else set()))


def is_loopback(host: str) -> bool:
    """Returns whether only this machine reaches an address that a server listens at."""
    if host == "localhost":
        return True
    try:
        return ip_address(host.strip("[]")).is_loopback
    except ValueError:  # a name may mean any address, and another one tomorrow
        return False


def refuse_other_pages(request: HttpRequest, *, operation: bool, hosts: Collection[str] | None = None) -> None:
    """Passes a program's request, and one of a page that came from here.

    Args:
        request: As it came.
        operation: Whether it is for an operation; to a page of this server others may have a link.
        hosts: The names with ports that this server has; None for any, where requests are signed with their name.

    Raises:
        AccessRefused: It is asked for by another name, or a page of another site asks.
    """
    host = _only(request, "host").lower()
    if not host or (hosts is not None and host not in hosts):
        raise _refused_page("this server is asked for by 127.0.0.1 or localhost and its port only")
    origins = [value for name, value in request.headers if name == "origin"]
    if any(origin.lower() not in {f"http://{host}", f"https://{host}"} for origin in origins):
        raise _refused_page("pages of other sites may not ask this server")
    site = _only(request, "sec-fetch-site") or "none"
    if site not in _OWN_SITES and (operation or not _is_followed_link(request)):
        raise _refused_page("pages of other sites may not ask this server")


def _is_followed_link(request: HttpRequest) -> bool:
    return request.method in {"GET", "HEAD"} and _only(request, "sec-fetch-mode") == "navigate"


def _only(request: HttpRequest, name: str) -> str:
    values = [value for each, value in request.headers if each == name]
    if len(values) > 1:
        raise _refused_page(f"the header {name} comes more than once")
    return values[0] if values else ""


def _refused_page(why: str) -> AccessRefused:
    return AccessRefused("AccessDeniedException", why)


class SignedGuard:
    """Lets in who signs with a key of the file, for what that key may do.

    Args:
        keys: Those that are in force now.
        store_id: Of the store that is served.
        fleet_of: Says which fleet something belongs to.
    """

    def __init__(self, keys: KeyFile, store_id: str, fleet_of: FleetOf) -> None:
        self._keys, self._store_id, self._fleet_of = keys, store_id, fleet_of
        self._used = UsedSignatures()

    def refuse_head(self, request: HttpRequest, operation: Operation | None) -> HttpAnswer | None:
        """Returns the refusal if the head alone says that the request will not be let in: no body is read for it."""
        return _refusal(lambda: self._check_head(request, operation))

    def admit(self, request: HttpRequest, operation: Operation | None) -> Caller | HttpAnswer:
        """Returns whose key signed a request; a page of the browser says itself who may see it."""
        found = Caller()

        def check() -> None:
            nonlocal found
            found = self._signer(request, operation)

        return _refusal(check) or found

    def permit(self, caller: Caller, operation: Operation, document: Spec) -> HttpAnswer | None:
        """Returns the refusal if the key may not do it."""
        return _refusal(
            lambda: check_right(self._known(caller.key), operation, document, self._store_id, self._fleet_of)
        )

    def secret_of(self, key_id: str) -> str | None:
        """Returns the secret of a key that may read, for who signs in on the page; None for every other."""
        key = self._reader(key_id)
        return key.secret if key else None

    def may_read(self, key_id: str, arn: str) -> bool:
        """Returns whether a key may see a resource of the store on the page."""
        key, named = self._reader(key_id), parse_reference(arn)
        if key is None or named.kind is None:
            return False
        return is_within(key, named.kind, named.path, self._store_id, self._fleet_of)

    def _reader(self, key_id: str) -> AccessKey | None:
        try:
            key = self._keys.key(key_id)
        except DocumentError as exc:
            _LOG.error("%s", exc)
            return None
        return key if key and "read" in key.rights else None

    def _check_head(self, request: HttpRequest, operation: Operation | None) -> None:
        refuse_other_pages(request, operation=operation is not None)
        if operation is not None:
            self._known(claim_of(request, time.time()).key_id)

    def _signer(self, request: HttpRequest, operation: Operation | None) -> Caller:
        refuse_other_pages(request, operation=operation is not None)
        if operation is None:
            return Caller()
        claim = claim_of(request, time.time())
        key = self._known(claim.key_id)
        check_signature(request, claim, key.secret)
        if operation.right != "read":
            self._used.use(claim.signature, time.monotonic())
        return Caller(key.key_id, key.name)

    def _known(self, key_id: str) -> AccessKey:
        key = self._keys.key(key_id)
        if key is None:
            raise unknown_key(key_id)
        return key


class LoopbackGuard:
    """Lets in every program that reaches this machine's own address, and no page of another site.

    Args:
        hosts: The names with ports that this server has.
    """

    def __init__(self, hosts: Collection[str]) -> None:
        self._hosts = hosts

    def refuse_head(self, request: HttpRequest, operation: Operation | None) -> HttpAnswer | None:
        """Returns the refusal of another name for this machine, and of a page of another site."""
        return _refusal(lambda: refuse_other_pages(request, operation=operation is not None, hosts=self._hosts))

    def admit(self, request: HttpRequest, operation: Operation | None) -> Caller | HttpAnswer:
        """Returns the nameless caller, or the refusal."""
        return self.refuse_head(request, operation) or Caller()

    def permit(self, caller: Caller, operation: Operation, document: Spec) -> HttpAnswer | None:  # noqa: ARG002
        """Allows everything."""
        return None


def _refusal(check: Callable[[], None]) -> HttpAnswer | None:
    try:
        check()
    except AccessRefused as exc:
        return error_answer(exc.status, exc.code, str(exc))
    except DocumentError as exc:
        _LOG.error("%s", exc)
        return error_answer(500, "InternalServerException", _KEYS_AWAY)
    return None
