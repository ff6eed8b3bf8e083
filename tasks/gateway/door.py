"""Who gets in: what a guard of the gateway is asked."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from specs.base import Spec
from specs.interface.operations import Operation
from tasks.gateway.messages import HttpAnswer, HttpRequest


@dataclass(frozen=True)
class Caller:
    """Who asks.

    Attributes:
        key: The id of the key that the request is signed with; empty where nobody signs.
        name: The key's.
    """

    key: str = ""
    name: str = ""


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

    def refuse_head(self, request: HttpRequest, operation: Operation | None) -> HttpAnswer | None:
        """Returns the refusal of a request whose body need not be read; called from the thread that serves all.

        Args:
            request: Without its body.
            operation: As for ``admit``.
        """
        ...

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


Note = Callable[[Call], None]
"""Keeps a line about a call before it is answered; called from several threads at once."""


def no_note(_call: Call) -> None:
    """Keeps nothing."""
