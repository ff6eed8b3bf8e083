"""Proxies that the environment names: which servers lie past them, and which of them no client here can use."""

import shlex
from collections.abc import Iterator, Mapping
from importlib.util import find_spec
from urllib.parse import urlsplit

_HERE = ("127.0.0.1", "localhost")
_PROXIES = ("HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY")
_PLAIN, _SOCKS = frozenset({"http", "https"}), frozenset({"socks5", "socks5h"})


def is_local(url: str) -> bool:
    """Returns whether the URL names this machine."""
    try:
        host = urlsplit(url).hostname or ""
    except ValueError:  # a bracket too many: it names nothing
        return False
    return host in {*_HERE, "::1"} or host.startswith("127.")


def proxy_exceptions(environment: Mapping[str, str]) -> dict[str, str]:
    """Returns the variables by which programs reach this machine's own servers past a configured proxy."""
    kept = environment.get("no_proxy") or environment.get("NO_PROXY") or ""
    hosts = ",".join(filter(None, [kept, *(host for host in _HERE if host not in kept.split(","))]))
    return {"no_proxy": hosts, "NO_PROXY": hosts}


def useless_proxies(environment: Mapping[str, str]) -> list[str]:
    """Returns the names of variables whose proxy Prefect's client refuses, whichever server is asked.

    It makes a connection to each of them before it asks, and needs another package for SOCKS.
    """
    return [name for name in _set_names(environment) if not _is_usable(environment[name])]


def without_useless_proxies(environment: Mapping[str, str]) -> dict[str, str]:
    """Returns the environment of a program that asks servers of this machine alone."""
    gone = useless_proxies(environment)
    return {name: value for name, value in environment.items() if name not in gone}


def exception_lines(url: str, environment: Mapping[str, str]) -> Iterator[str]:
    """Yields lines that a shell obeys, so that its programs reach a server past a proxy; none where none is between.

    Args:
        url: Of the server.
        environment: Of the shell.
    """
    if is_local(url) and _set_names(environment):
        for name, hosts in proxy_exceptions(environment).items():
            yield f"export {name}={shlex.quote(hosts)}"


def _set_names(environment: Mapping[str, str]) -> list[str]:
    return [name for name, value in sorted(environment.items()) if value and name.upper() in _PROXIES]


def _is_usable(proxy: str) -> bool:
    try:
        parts = urlsplit(proxy if "://" in proxy else f"http://{proxy}")
        known = parts.scheme in _PLAIN or (parts.scheme in _SOCKS and find_spec("socksio") is not None)
        return known and bool(parts.hostname) and parts.port != 0
    except ValueError:  # a port that is no number
        return False
