# ruff: noqa: ANN401 - a stub for a package without types says Any where it does not know
"""The part of MJX that Simyard names in its types; the rest is Any."""

from typing import Any

class Model:
    def replace(self, **fields: Any) -> Model: ...
    def __getattr__(self, name: str) -> Any: ...

class Data:
    def replace(self, **fields: Any) -> Data: ...
    def __getattr__(self, name: str) -> Any: ...

def __getattr__(name: str) -> Any: ...  # pyright: ignore[reportIncompleteStub] - incomplete on purpose
