"""Options of environments that share a program: 16 lanes at most, two small worlds, episodes of two seconds."""

from typing import Any

import pytest

from tests.factories.simulations import cluttered


@pytest.fixture(scope="session")
def options() -> dict[str, Any]:
    """Returns what the environments of these tests are made of."""
    worlds = [cluttered(seed) for seed in range(2)]
    return {"worlds": worlds, "seeds": 4, "duration_s": 1.0, "environment": {"GOALS": "1"}}
