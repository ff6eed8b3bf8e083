"""Requests that a page of another site makes a browser send.

A browser says which page asks (``Origin``, ``Sec-Fetch-Site``) and by which name it found this address (``Host``). A
name of an attacker's may lead here (DNS rebinding). Programs send neither Origin nor Sec-Fetch-Site. A browser sends
Origin with every POST and DELETE, forms among them, so the type of a body need not be looked at.
"""

from collections.abc import Collection
from ipaddress import ip_address

from specs.errors import AccessRefused
from tasks.gateway.messages import HttpRequest

_OWN_SITES = frozenset({"same-origin", "none"})
_NAMES = frozenset({"localhost", "127.0.0.1", "[::1]"})


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
        raise _refused("this server is asked for by 127.0.0.1 or localhost and its port only")
    origins = [value for name, value in request.headers if name == "origin"]
    if any(origin.lower() not in {f"http://{host}", f"https://{host}"} for origin in origins):
        raise _refused("pages of other sites may not ask this server")
    site = _only(request, "sec-fetch-site") or "none"
    if site not in _OWN_SITES and (operation or not _is_followed_link(request)):
        raise _refused("pages of other sites may not ask this server")


def _is_followed_link(request: HttpRequest) -> bool:
    return request.method in {"GET", "HEAD"} and _only(request, "sec-fetch-mode") == "navigate"


def _only(request: HttpRequest, name: str) -> str:
    values = [value for each, value in request.headers if each == name]
    if len(values) > 1:
        raise _refused(f"the header {name} comes more than once")
    return values[0] if values else ""


def _refused(why: str) -> AccessRefused:
    return AccessRefused("AccessDeniedException", why)
