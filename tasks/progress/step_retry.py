"""When Prefect runs a step again: if the store was away, and never for a fault of a document.

A step that is run again finds what it did before by its client request token, so that nothing is done twice. Prefect's
cache and its transactions would remember the same on the side of its server, which may forget, and which other ways
into Simyard do not ask; so they are not used (docs/reference/prefect.md, section 7).
"""

from typing import Any, Protocol

from specs.errors import StoreAway

RETRY_DELAYS_S = (5.0, 20.0, 60.0)


class _EndState(Protocol):
    """A state of Prefect's, with what its task raised."""

    data: Any


def is_store_away(_task: object, _task_run: object, state: _EndState) -> bool:
    """Returns whether a task failed because its store did not answer; Prefect calls it before it runs a task again."""
    return isinstance(state.data, StoreAway)


STORE_RETRY: dict[str, Any] = {
    "retries": len(RETRY_DELAYS_S),
    "retry_delay_seconds": [*RETRY_DELAYS_S],
    "retry_condition_fn": is_store_away,
}
"""Options of a task whose step may be run again."""
