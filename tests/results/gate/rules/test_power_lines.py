"""What `simyard plan` says of a rule's power is written as people write it."""

import pytest

from tasks.results.gate.rules.rule import PlannedEpisodes
from tasks.results.gate.rules.rule_answers import worth_line


@pytest.mark.parametrize(("icc", "said"), [(2.1e-17, "0"), (0.0, "0"), (0.05, "0.05"), (0.123, "0.12"), (None, "0.05")])
def test_a_correlation_of_rounding_is_none(icc: float | None, said: str) -> None:
    planned = PlannedEpisodes(episodes=64, pairs=0, audited=0, worlds=8, icc=icc)
    assert worth_line(planned).endswith(f"at an ICC of {said}")
