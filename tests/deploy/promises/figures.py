"""How often a promise is tried, in short and for long, and where that is written down."""

from typing import Protocol

import pytest

REPORT = "SIMYARD_SOAK_REPORT"


class Figures(Protocol):
    """Writes down that a promise was kept, and how often it was tried."""

    def __call__(self, promise: int, store: str, **counts: int | float) -> None: ...


def sizes(*, short: int, long: int) -> pytest.MarkDecorator:
    """Gives a test its parameter ``size``; the long form runs with the marker ``soak`` alone."""
    soak = [pytest.mark.soak, pytest.mark.timeout(3600)]
    return pytest.mark.parametrize("size", [pytest.param(short, id="short"), pytest.param(long, id="long", marks=soak)])


def kind(url: str) -> str:
    """Returns ``file`` or ``s3``."""
    return url.partition(":")[0]
