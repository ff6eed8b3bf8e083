"""Simyard's log lines on the Logs tab of a flow run's page.

Prefect sends there what its own loggers say, and those that PREFECT_LOGGING_EXTRA_LOGGERS names. It reads that setting
when it is imported, and a worker imports it before Simyard. So a flow adds the handler itself, as the setting would
(docs/reference/prefect.md, section 9).
"""

import logging
from collections.abc import Generator
from contextlib import contextmanager
from threading import Lock

from prefect.context import FlowRunContext, TaskRunContext
from prefect.logging.handlers import APILogHandler, PrefectConsoleHandler

from tasks.progress.log_lines import LOGGERS, chosen_log_format

# Prefect gives the loggers of PREFECT_LOGGING_EXTRA_LOGGERS what it gives this one, but for the level.
_PREFECTS_EXTRA = "prefect.extra"
_turn = Lock()
_blocks = 0
_undo: list[tuple[logging.Logger, int, logging.Handler | None]] = []


@contextmanager
def log_on_page() -> Generator[None, None, None]:
    """Sends what Simyard logs inside the ``with`` block to the page of the flow or task run that it is in.

    The level is PREFECT_LOGGING_LEVEL, where nobody chose one for Simyard's loggers. Blocks may be nested, and lie in
    several threads.
    """
    _begin()
    try:
        yield
    finally:
        _end()


def _begin() -> None:
    global _blocks  # noqa: PLW0603 - loggers are the process's, and so is who needs their handlers
    written = chosen_log_format() is not None  # a format that there is not is refused before anything is changed
    with _turn:
        _blocks += 1
        if _blocks > 1:
            return
        level = logging.getLogger(_PREFECTS_EXTRA).getEffectiveLevel()
        for logger in map(logging.getLogger, LOGGERS):
            handler = None if any(isinstance(each, APILogHandler) for each in logger.handlers) else _handler()
            _undo.append((logger, logger.level, handler))
            if handler:
                logger.addHandler(handler)
            if logger.level == logging.NOTSET:
                logger.setLevel(level)
        if written:
            _spare_console()


def _end() -> None:
    global _blocks  # noqa: PLW0603 - same
    with _turn:
        _blocks -= 1
        if _blocks:
            return
        for logger, level, handler in _undo:
            logger.setLevel(level)
            if handler:
                logger.removeHandler(handler)
        _undo.clear()


def _handler() -> logging.Handler:
    handler = APILogHandler()
    handler.addFilter(_is_in_a_run)
    return handler


def _is_in_a_run(_record: logging.LogRecord) -> bool:
    """Returns whether a line has a page: outside of runs the handler would only warn that it has none."""
    return FlowRunContext.get() is not None or TaskRunContext.get() is not None


def _spare_console() -> None:
    """Has Prefect's console leave out what SIMYARD_LOG_FORMAT writes to stderr already, as one line for a program."""
    for handler in logging.getLogger().handlers:
        if isinstance(handler, PrefectConsoleHandler) and _is_of_others not in handler.filters:
            handler.addFilter(_is_of_others)


def _is_of_others(record: logging.LogRecord) -> bool:
    return not chosen_log_format() or record.name.split(".")[0] not in LOGGERS
