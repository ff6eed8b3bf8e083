"""What went wrong as the error of RoboMaker's that is documented for the operation and comes closest."""

import json
import sys
import tempfile
from pathlib import Path

from specs.arn import ArnForm
from specs.errors import (
    ConcurrentDeployment,
    DocumentError,
    IdempotentParameterMismatch,
    LimitExceeded,
    ResourceAlreadyExists,
    ResourceNotFound,
    SimyardError,
    StoreAway,
    StoreError,
    StoreThrottled,
)
from specs.interface.operations import STATUSES, ErrorName, Operation
from tasks.gateway.messages import HttpAnswer
from tasks.gateway.places import without_places

_MOST_CHARACTERS = 4000
_DEFECT = "this is a defect of Simyard; the log of simyard serve says more"
_AWAY = "the store does not answer now; the same request may succeed in a minute"
_STORE = "the store could not do it; the log of simyard serve says more"
_NAMES: tuple[tuple[type[Exception], ErrorName], ...] = (
    (ResourceNotFound, "ResourceNotFound"),
    (ResourceAlreadyExists, "ResourceAlreadyExists"),
    (IdempotentParameterMismatch, "IdempotentParameterMismatch"),
    (LimitExceeded, "LimitExceeded"),
    (ConcurrentDeployment, "ConcurrentDeployment"),
    (DocumentError, "InvalidParameter"),
    (StoreThrottled, "Throttling"),
    (StoreAway, "ServiceUnavailable"),
)


class ErrorAnswers:
    """Errors as clients are told them: in RoboMaker's words, without a place on this machine.

    Args:
        form: Of the ARNs in messages.
        store_url: What no message may show.
    """

    def __init__(self, form: ArnForm, store_url: str) -> None:
        self._form = form
        self._store_url = store_url
        here = (str(Path.cwd()), str(Path.home()), tempfile.gettempdir(), sys.prefix, sys.base_prefix)
        self._here = tuple(each for each in here if len(each) > 1)

    def answer(self, operation: Operation, exc: Exception) -> HttpAnswer:
        """Returns the answer of an operation that an exception ended."""
        name = next((name for kind, name in _NAMES if isinstance(exc, kind)), "InternalServer")
        if name not in operation.errors:
            name = "InvalidParameter" if isinstance(exc, DocumentError) else "InternalServer"
        return error_answer(STATUSES.get(name, 400), f"{name}Exception", self._message(exc))

    def _message(self, exc: Exception) -> str:
        if isinstance(exc, StoreAway):
            return _AWAY
        if isinstance(exc, StoreError):
            return _STORE
        if not isinstance(exc, SimyardError):
            return _DEFECT
        text = "; ".join(map(str, exc.faults)) if isinstance(exc, DocumentError) else str(exc)
        text = without_places(text, self._store_url)
        for place in self._here:
            text = text.replace(place, "the store")
        return self._form.in_prose(text)[:_MOST_CHARACTERS]


def error_answer(status: int, code: str, message: str) -> HttpAnswer:
    """Returns an error in the form that all SDKs read."""
    return HttpAnswer(status, json.dumps({"message": message}).encode(), error=code)
