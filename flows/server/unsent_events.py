"""What Prefect's client has not sent yet."""

from prefect.events.worker import EventsWorker
from prefect.logging.handlers import APILogWorker


def flush_prefect() -> None:
    """Sends what Prefect still holds back; a server that ends with this run would not get it otherwise."""
    APILogWorker.drain_all(timeout=5)
    EventsWorker.drain_all(timeout=5)
