"""What an operation is answered with."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from specs.base import Spec
from tasks.storage.base.store import Store


@dataclass(frozen=True)
class Gateway:
    """What every operation has at hand; several requests are answered at once, each in a thread.

    Attributes:
        store: Where everything is.
        wake: Tells the workers of this machine that the queue has something new; those elsewhere look themselves.
    """

    store: Store
    wake: Callable[[], None]


Handler = Callable[[Gateway, Any], Spec]
"""Answers one operation: a request of its shape in, an answer of its shape out; raises specs.errors."""
Handlers = Mapping[str, Handler]
