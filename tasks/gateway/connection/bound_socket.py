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
    # asyncio sends small answers at once only where the socket says that it is TCP's: 1 ms and not 45.
    bound = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind((host.strip("[]"), port))
        bound.listen(_WAITING)
    except OSError as exc:
        bound.close()
        option, value = ("--host", host) if isinstance(exc, socket.gaierror) else ("--port", str(port))
        allowed = f"an address of this machine and a port that is free: {exc.strerror or exc}"
        raise DocumentError([Fault(path=option, value=repr(value), allowed=allowed)]) from exc
    return bound
