"""Heartbeats of Prefect's flow runs: sent as ever, but no flow waits for the thread that sends them."""

from functools import partial

from prefect import flow_engine


def leave_heartbeats() -> None:
    """Makes each later sync flow of this process end without waiting for its heartbeat thread.

    The thread sleeps for a second at a time, and a sync flow waits for its end; three flows in one another wait 1.7 s
    (docs/reference/prefect.md, section 3). Prefect's async flows do not wait, and nothing is lost: a thread that wakes
    up after its flow sends nothing.
    """
    # Prefect has no setting for this: the argument is there, and only its own callers choose it.
    sent = flow_engine._send_heartbeats  # noqa: SLF001 # pyright: ignore[reportPrivateUsage]
    if not isinstance(sent, partial):
        flow_engine._send_heartbeats = partial(sent, join_on_exit=False)  # noqa: SLF001 # pyright: ignore[reportPrivateUsage]
