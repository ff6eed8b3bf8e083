"""What tasks of Prefect share: retries while the store is away, names of runs, bars of progress.

A step that is run again finds what it did before by its client request token, so that nothing is done twice. Prefect's
cache and its transactions would remember the same on the side of its server, which may forget, and which other ways
into Simyard do not ask; so they are not used (docs/reference/prefect.md, section 7).
"""

import logging
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from typing import Any, Protocol, cast
from uuid import UUID

from httpx import TransportError
from prefect.artifacts import create_progress_artifact, update_progress_artifact
from prefect.context import SettingsContext, get_settings_context
from prefect.exceptions import PrefectHTTPStatusError
from prefect.settings import PREFECT_CLIENT_MAX_RETRIES, temporary_settings

from specs.errors import StoreAway
from tasks.progress.listener import Progress, artifact_key, current_listener, listen_to_progress, stage_progress

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


_LOG = logging.getLogger(__name__)
# `--watch` prints every update, and each is a request to the server.
_INTERVAL_S = 1.0
_INTERVAL_AWAY_S = 10.0


def named_by(name: Callable[[Mapping[str, Any]], str]) -> Callable[[], str]:
    """Returns a function that names a task run by its parameters, as Prefect's types have it.

    Prefect hands the parameters to a function that has an argument ``parameters``; its types say so of objects only.
    """
    return cast("Callable[[], str]", name)


@contextmanager
def show_progress(stage: str, key: str) -> Generator[Progress, None, None]:
    """Shows Prefect how far a stage is, whoever tells it inside the block; yields a function that tells it.

    Args:
        stage: What a person calls it, such as ``Worlds``.
        key: Of the document's artifact, such as ``worlds-progress``: lower-case letters, digits and dashes.
    """
    bar, terminal = _Bar(stage, artifact_key(key)), current_listener()
    bar.show(0.0)

    def hear(told: str, done: int, total: int) -> None:
        terminal(told, done, total)
        if told == stage and bar.is_due():
            bar.show(100.0 * done / max(total, 1))

    with listen_to_progress(hear):
        yield stage_progress(stage)
    bar.show(100.0)


class _Bar:
    """A stage's bar on the server; while that is away the bar stands still, and the stage goes on."""

    def __init__(self, stage: str, key: str) -> None:
        self._stage, self._key = stage, key
        self._artifact: UUID | None = None
        self._shown_s = 0.0
        self._is_away = False
        self._settings: tuple[SettingsContext, SettingsContext] | None = None

    def is_due(self) -> bool:
        """Returns whether the bar was not moved for a while."""
        return time.monotonic() - self._shown_s >= (_INTERVAL_AWAY_S if self._is_away else _INTERVAL_S)

    def show(self, percent: float) -> None:
        """Moves the bar; an update that the server does not take is dropped, for the next one says more."""
        try:
            with self._without_retries():
                self._send(percent)
        except (TransportError, PrefectHTTPStatusError) as exc:
            if isinstance(exc, PrefectHTTPStatusError) and exc.response.status_code < 500:
                raise
            if not self._is_away:
                _LOG.warning(
                    "%s: progress is not told, the Prefect server does not answer (%s)", self._stage, type(exc).__name__
                )
            self._is_away = True
        else:
            self._is_away = False
        self._shown_s = time.monotonic()

    def _without_retries(self) -> SettingsContext:
        """Returns the settings as they are, without retries; made once, because they take as long as a few updates."""
        now = get_settings_context()
        if self._settings is None or self._settings[0] is not now:
            with temporary_settings({PREFECT_CLIENT_MAX_RETRIES: 0}):
                self._settings = now, get_settings_context()
        return self._settings[1]

    def _send(self, percent: float) -> None:
        if self._artifact is None:
            self._artifact = cast(
                "UUID", create_progress_artifact(progress=percent, key=self._key, description=self._stage)
            )
        else:
            update_progress_artifact(self._artifact, progress=percent)
