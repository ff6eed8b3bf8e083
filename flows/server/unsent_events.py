"""What Prefect's client has not sent yet."""

import sys
from threading import Thread

_DRAIN_S = 5.0
_SENDERS = ("prefect.events.worker", "prefect.logging.handlers")


def flush_prefect() -> None:
    """Sends what Prefect still holds back, within ten seconds; a server that ends now would not get it otherwise.

    Prefect would try for a minute at the process's end, in vain. Where nothing has been imported that holds something
    back, nothing is imported for it either.
    """
    if not any(module in sys.modules for module in _SENDERS):
        return
    # Where an event loop runs, Prefect would return an awaitable.
    thread = Thread(target=_drain, name="simyard flush")
    thread.start()
    thread.join()


def _drain() -> None:
    from prefect.events.worker import EventsWorker  # noqa: PLC0415 - a caller may never have imported Prefect
    from prefect.logging.handlers import APILogWorker  # noqa: PLC0415 - likewise

    APILogWorker.drain_all(timeout=_DRAIN_S)
    EventsWorker.drain_all(timeout=_DRAIN_S)
