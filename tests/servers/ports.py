"""Ports of this machine for servers that are told where to listen."""

from itertools import islice
from random import SystemRandom

from tasks.server.health import is_port_free

# Below those that Linux gives to whoever connects: nobody has one before its server listens, and who tries to connect
# until it does never meets themselves there.
_PORTS = range(10_000, 32_768)


def free_ports(number: int) -> list[int]:
    """Returns so many ports of 127.0.0.1 that nobody listens on."""
    return list(islice(filter(is_port_free, SystemRandom().sample(_PORTS, len(_PORTS))), number))


def free_port() -> int:
    """Returns a port of 127.0.0.1 that nobody listens on."""
    return free_ports(1)[0]
