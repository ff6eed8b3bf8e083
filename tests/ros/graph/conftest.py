"""A graph with its loop, for each test."""

from collections.abc import Iterator

import pytest

from tests.ros.graph.episode import Episode


@pytest.fixture
def episode() -> Iterator[Episode]:
    """A graph of a robot with a clock, a scan, a latched map and a command."""
    with Episode() as each:
        yield each
