"""Logs for a program to read: one event a line, JSON or ``key=value``, as SIMYARD_LOG_FORMAT asks; and durations."""

import json
import logging
import os
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager
from datetime import UTC, datetime
from threading import Lock
from typing import Literal, get_args

from pydantic import JsonValue

from specs.errors import DocumentError
from specs.untrusted_text import terminal_json

LogFormat = Literal["json", "keyvalue"]
LOG_FORMAT = "SIMYARD_LOG_FORMAT"
LOGGERS = ("flows", "tasks", "specs")
"""The packages whose events these are, each a logger above its modules'; what libraries log is Prefect's business."""
logger = logging.getLogger(__name__)


class EventLines(logging.Formatter):
    """An event as a line: its time, level, logger, text, and the facts that its writer gave as ``fields``."""

    def __init__(self, form: LogFormat) -> None:
        """Makes lines of that format."""
        super().__init__()
        self._form = form

    def format(self, record: logging.LogRecord) -> str:
        """Returns the line, without its end."""
        event = self._event(record)
        if self._form == "json":
            return terminal_json(json.dumps(event, ensure_ascii=False))
        return " ".join(f"{key}={_shown(value)}" for key, value in event.items())

    def _event(self, record: logging.LogRecord) -> dict[str, JsonValue]:
        at = datetime.fromtimestamp(record.created, tz=UTC).isoformat(timespec="milliseconds")
        event: dict[str, JsonValue] = {
            "time": at,
            "level": record.levelname,
            "logger": record.name,
            "event": record.getMessage(),
            **getattr(record, "fields", {}),
        }
        return {**event, "exception": self.formatException(record.exc_info)} if record.exc_info else event


def chosen_log_format() -> LogFormat | None:
    """Returns what SIMYARD_LOG_FORMAT asks for; None if nothing.

    Raises:
        DocumentError: There is no such format.
    """
    asked = os.environ.get(LOG_FORMAT, "")
    for form in get_args(LogFormat):
        if asked == form:
            return form
    if asked:
        raise DocumentError.of(LOG_FORMAT, asked, " or ".join(get_args(LogFormat)))
    return None


@contextmanager
def log_in_chosen_format() -> Generator[None, None, None]:
    """Writes what Simyard logs inside the ``with`` block to stderr, if SIMYARD_LOG_FORMAT asks for it.

    Raises:
        DocumentError: There is no such format.
    """
    form = chosen_log_format()
    if form is None or any(_is_ours(handler) for handler in logging.getLogger(LOGGERS[0]).handlers):
        yield
        return
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(EventLines(form))
    before = {name: logging.getLogger(name).level for name in LOGGERS}
    for name in LOGGERS:
        logging.getLogger(name).addHandler(handler)
        logging.getLogger(name).setLevel(logging.INFO)
    try:
        yield
    finally:
        for name, level in before.items():
            logging.getLogger(name).removeHandler(handler)
            logging.getLogger(name).setLevel(level)


def _is_ours(handler: logging.Handler) -> bool:
    return isinstance(handler.formatter, EventLines)


def _shown(value: JsonValue) -> str:
    """Returns a value that no reader takes for several: quoted where it has more than letters, digits and a few."""
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    plain = text and text.isprintable() and not any(character in " \"'=" for character in text)
    return text if plain else json.dumps(text, ensure_ascii=not text.isprintable())


_taken_s: dict[str, float] = {}
_turn = Lock()


@contextmanager
def log_duration(step: str) -> Generator[None, None, None]:
    """Tells the log how long the ``with`` block took: a program's log, as a person's is to tell a story in few lines.

    Args:
        step: What it does, as a name in code.
    """
    start_s = time.perf_counter()
    try:
        yield
    finally:
        seconds = time.perf_counter() - start_s
        with _turn:
            _taken_s[step] = _taken_s.get(step, 0.0) + seconds
        level = logging.DEBUG if chosen_log_format() is None else logging.INFO
        fields = {"step": step, "seconds": round(seconds, 3)}
        logger.log(level, "%s took %.1f s", step, seconds, extra={"fields": fields})


def taken_s(*steps: str) -> float:
    """Returns how long steps took in this process until now; those that are under way count when they have ended."""
    with _turn:
        return sum(_taken_s.get(step, 0.0) for step in steps)
