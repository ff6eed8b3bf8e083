"""The socket that a gateway listens on."""

import socket

from specs.base import Fault
from specs.errors import DocumentError

_WAITING = 512
"""Connections that the kernel keeps while the gateway has no time for them."""


def bound_socket(host: str, port: int) -> socket.socket:
    """Returns a socket that is bound to an address and listens.

    Raises:
        DocumentError: Another program listens there, or this machine has no such address.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host.strip("[]"), port), family=family, backlog=_WAITING)
    except OSError as exc:
        option, value = ("--host", host) if isinstance(exc, socket.gaierror) else ("--port", str(port))
        allowed = f"an address of this machine and a port that is free: {exc.strerror or exc}"
        raise DocumentError([Fault(path=option, value=repr(value), allowed=allowed)]) from exc
