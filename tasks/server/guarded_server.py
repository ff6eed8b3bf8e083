"""Prefect's server, for this machine and its own pages only: the program of the servers that Simyard starts.

Run as ``python -m tasks.server.guarded_server PORT [--reserve]``: in reserve it imports, and starts when its input says
so. It is what ``prefect server start`` is, but for the application that stands before Prefect's: Prefect has no setting
for the names that its server answers to. Its password comes in PREFECT_SERVER_API_AUTH_STRING, where no other account
of the machine sees it.
"""

import sys

from tasks.server.collector_pause import pause_collector
from tasks.server.own_origin import OwnOrigin
from tasks.server.process import IN_RESERVE
from tasks.server.waits import BusyDatabase, LeftReader

with pause_collector():
    import uvicorn
    from prefect.server.api.server import create_app
    from prefect.settings import get_current_settings

_HERE = ("127.0.0.1", "localhost")


def main(arguments: list[str]) -> None:
    """Serves on a port of 127.0.0.1 until a signal ends it."""
    port = int(arguments[0])
    if arguments[1:] == [IN_RESERVE] and not sys.stdin.buffer.readline():
        return  # whoever began it has ended, or needs no server
    settings = get_current_settings().server
    with pause_collector():
        guarded = LeftReader(BusyDatabase(create_app(final=True)))
    uvicorn.run(
        OwnOrigin(guarded, [f"{name}:{port}" for name in _HERE]),  # pyright: ignore[reportArgumentType]
        host=_HERE[0],
        port=port,
        timeout_keep_alive=settings.api.keepalive_timeout,
        ws_ping_interval=settings.api.websocket_ping_interval,
        ws_ping_timeout=settings.api.websocket_ping_timeout,
        log_level=settings.logging_level.lower(),
    )


if __name__ == "__main__":
    main(sys.argv[1:])
