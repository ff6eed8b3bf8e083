"""What Prefect needs to know when a program calls a flow of Simyard's, as `simyard.run` does."""

import logging
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from prefect import settings
from prefect.context import FlowRunContext, TaskRunContext
from prefect.exceptions import CancelledRun
from prefect.logging.configuration import ensure_logging_setup
from prefect.logging.handlers import PrefectConsoleHandler

from specs.errors import StageFailed

_silent: ContextVar[bool] = ContextVar("simyard_silent", default=False)


def is_in_flow_run() -> bool:
    """Returns whether the caller is a flow or a task of Prefect's, which has a server."""
    return FlowRunContext.get() is not None or TaskRunContext.get() is not None


@contextmanager
def call_flow_at(server: Mapping[str, str]) -> Generator[None, None, None]:
    """Lets a program call a flow in the block.

    Prefect uses the server, also where it was imported before there was one. What the flow logs is on its page, and not
    on the program's console.

    Args:
        server: The variables by which Prefect reaches it.
    """
    known: dict[Any, str] = {getattr(settings, name): value for name, value in server.items()}
    with settings.temporary_settings(known), _silent_console():
        yield


@contextmanager
def canceled_as_failure() -> Generator[None, None, None]:
    """Raises what Prefect raises for a cancelled flow run as Simyard's own exception.

    Raises:
        StageFailed: Somebody cancelled it.
    """
    try:
        yield
    except CancelledRun as exc:
        raise StageFailed("Canceled", str(exc)) from exc


@contextmanager
def _silent_console() -> Generator[None, None, None]:
    ensure_logging_setup()
    token = _silent.set(True)
    for handler in logging.getLogger().handlers:
        if isinstance(handler, PrefectConsoleHandler):
            handler.addFilter(_is_shown)  # once, however many runs there are
    try:
        yield
    finally:
        _silent.reset(token)


def _is_shown(record: logging.LogRecord) -> bool:
    """Returns whether a line is of another flow, such as one of the program's own, or grave."""
    return not _silent.get() or record.levelno >= logging.CRITICAL
