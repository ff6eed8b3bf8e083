"""The listener that hears of each change of a job's status: a context variable, so that no function needs a parameter.

It hears of what is in the store already, from the process that changed it, so that a change is announced once at most
however often a job is killed and continued.
"""

import logging
from collections.abc import Callable, Generator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import NamedTuple

from specs.job_kinds import JobKind

logger = logging.getLogger(__name__)


class Transition(NamedTuple):
    """A job's change from one status to another.

    Attributes:
        kind: Of the job, such as ``simulation-job-batch``.
        arn: The job's.
        was: Its status before.
        status: Its status now.
        failure_code: RoboMaker's failure code, or empty.
        failure_reason: For a person, or empty.
        flow: The flow that a run is of: ``pipeline``, or a stage that runs alone; empty for any other job.
    """

    kind: JobKind
    arn: str
    was: str
    status: str
    failure_code: str
    failure_reason: str
    flow: str = ""


Listener = Callable[[Transition], None]


def _nobody(transition: Transition) -> None:
    """Drops what is told: nobody listens."""


_listener: ContextVar[Listener] = ContextVar("simyard_transition_listener", default=_nobody)


@contextmanager
def listen_to_transitions(listener: Listener) -> Generator[None, None, None]:
    """Lets the listener hear of transitions inside the ``with`` block; it must not raise."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def announce_transition(transition: Transition) -> None:
    """Tells the log, and the listener of this context, of a transition that is in the store."""
    fields = {name: value for name, value in transition._asdict().items() if value}
    why = [text for text in (transition.failure_code, transition.failure_reason) if text]
    logger.info("%s", ": ".join([f"{transition.arn} is {transition.status}", *why]), extra={"fields": fields})
    _listener.get()(transition)
