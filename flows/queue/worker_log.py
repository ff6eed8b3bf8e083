"""The log of a worker: on stderr, as SIMYARD_LOG_FORMAT asks, or as plain lines."""

import logging
import sys

from specs.terminal_text import terminal_text
from tasks.progress.log_lines import LOGGERS, EventLines, chosen_log_format


class _PlainLines(logging.Formatter):
    """An event as a line with its time and level, in which no text from a document moves the cursor."""

    def format(self, record: logging.LogRecord) -> str:
        return terminal_text(super().format(record))


def log_to_stderr() -> None:
    """Writes what Simyard logs in this process to stderr from now on; what Prefect says is on the pages of its runs.

    Raises:
        DocumentError: SIMYARD_LOG_FORMAT asks for a format that there is not.
    """
    form = chosen_log_format()
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(EventLines(form) if form else _PlainLines("%(asctime)s %(levelname)s %(message)s"))
    for logger in map(logging.getLogger, LOGGERS):
        logger.addHandler(handler)
        logger.setLevel(logging.INFO)
        logger.propagate = False
