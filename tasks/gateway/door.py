"""Who gets in: what a guard of the gateway is asked, and the guard of a gateway without signatures."""

import logging
from dataclasses import dataclass
from typing import Protocol

from specs.base import Spec
from specs.interface.operations import Operation
from tasks.gateway.error_answers import error_answer
from tasks.gateway.messages import HttpAnswer, HttpRequest

_LOG = logging.getLogger(__name__)
_LOOPBACK = frozenset({"127.0.0.1", "localhost", "[::1]"})


@dataclass(frozen=True)
class Caller:
    """Who asks.

    Attributes:
        key: The id of the key that the request is signed with; empty where nobody signs.
    """

    key: str = ""


@dataclass(frozen=True)
class Call:
    """A request that was answered.

    Attributes:
        request: As it came.
        answer: As it was sent.
        duration_s: From the whole request to the answer.
        caller: None if the guard did not let it in.
        operation: None if it was for none.
        document: The request's members as a document, with ARNs in Simyard's own form; None if it was refused before.
    """

    request: HttpRequest
    answer: HttpAnswer
    duration_s: float
    caller: Caller | None = None
    operation: Operation | None = None
    document: Spec | None = None


class Guard(Protocol):
    """Decides about each request; called from several threads at once."""

    def admit(self, request: HttpRequest, operation: Operation | None) -> Caller | HttpAnswer:
        """Returns who asks, or the refusal; asked once the body is there, before anything is done with it.

        Args:
            request: As it came.
            operation: What it is for; None for a page of the browser, and for what is unknown.
        """
        ...

    def permit(self, caller: Caller, operation: Operation, document: Spec) -> HttpAnswer | None:
        """Returns the refusal if this caller may not do it; None lets the operation go on.

        Args:
            caller: Whom ``admit`` let in.
            operation: What is asked for.
            document: The request, checked, with ARNs in Simyard's own form.
        """
        ...

    def note(self, call: Call) -> None:
        """Keeps a line about a call that was answered."""
        ...


class LoopbackGuard:
    """Lets in every program that reaches this machine's own address, and no page of a browser."""

    def admit(self, request: HttpRequest, operation: Operation | None) -> Caller | HttpAnswer:  # noqa: ARG002 - a Guard's
        """Returns the nameless caller; refuses hosts that are not this machine, and pages of others."""
        headers = dict(request.headers)
        host = headers.get("host", "")
        name = host if host.endswith("]") else host.rpartition(":")[0] or host
        # A page in a browser can send a request here, and a name of its own can be made to mean this address.
        if name.lower() not in _LOOPBACK or "origin" in headers:
            return error_answer(403, "AccessDeniedException", "without signatures only programs of this machine get in")
        return Caller()

    def permit(self, caller: Caller, operation: Operation, document: Spec) -> HttpAnswer | None:  # noqa: ARG002 - same
        """Allows everything."""
        return None

    def note(self, call: Call) -> None:
        """Logs the call."""
        took_ms = 1000 * call.duration_s
        name = call.operation.name if call.operation else f"{call.request.method} {call.request.raw_path[:200]!a}"
        _LOG.info("%s %d %s %.1f ms", name, call.answer.status, call.answer.error, took_ms)
