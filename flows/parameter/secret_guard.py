"""A flow whose parameters carry no secret, and may name a file: a secret is refused before Prefect keeps or logs it.

Prefect makes the run, with its parameters, before it looks at them, and logs what it refuses
(docs/reference/prefect.md, section 4). So this module looks first, where Prefect writes parameters as JSON.
"""

from collections.abc import Mapping
from typing import Any, ParamSpec, TypeVar, cast

from prefect import Flow

from flows.parameter.document_parameter import with_document
from flows.parameter.store_parameter import ALLOWED, has_secret
from specs.base import Fault
from specs.errors import DocumentError

P = ParamSpec("P")
R = TypeVar("R")
_STORE = "store"


class GuardedFlow(Flow[P, R]):
    """A flow that refuses a store with a password in it, and reads its document from a file, however it is called."""

    def serialize_parameters(self, parameters: dict[str, Any]) -> dict[str, Any]:
        """Returns the parameters as JSON for a run that is about to be made.

        Raises:
            DocumentError: The store carries a secret.
        """
        _require_no_secret(parameters)
        return super().serialize_parameters(parameters)

    def validate_parameters(self, parameters: dict[str, Any]) -> dict[str, Any]:
        """Returns the parameters as the flow's types; Prefect would log those that are none, with the secret.

        Raises:
            DocumentError: The store carries a secret, or the file that is to be the document is none.
        """
        _require_no_secret(parameters)
        return super().validate_parameters(with_document(self.fn, parameters))

    def with_options(self, **options: Any) -> "GuardedFlow[P, R]":  # noqa: ANN401 - Prefect's, handed on
        """Returns a flow with other options, which refuses the same."""
        changed = super().with_options(**options)
        changed.__class__ = type(self)
        return cast("GuardedFlow[P, R]", changed)


def guarded(flow: Flow[P, R]) -> Flow[P, R]:
    """Returns the flow, made to refuse a store with a password in it."""
    flow.__class__ = GuardedFlow
    return flow


def _require_no_secret(parameters: Mapping[str, object]) -> None:
    store = parameters.get(_STORE)
    if isinstance(store, str) and has_secret(store):
        raise DocumentError([Fault(path=_STORE, value="a URL with a secret in it", allowed=ALLOWED)], "parameters")
