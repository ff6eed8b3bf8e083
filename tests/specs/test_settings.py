"""Limits come from the environment, and nonsense in it is refused by name."""

import pytest

from specs.errors import DocumentError
from specs.settings import max_worlds_of_job, server_wait_s


def test_the_limit_is_robomakers_unless_a_team_raises_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SIMYARD_MAX_WORLDS", raising=False)
    assert max_worlds_of_job() == 50
    monkeypatch.setenv("SIMYARD_MAX_WORLDS", "10000")
    assert max_worlds_of_job() == 10000


@pytest.mark.parametrize("text", ["many", "0", "-3", "1e4", "\u0663"])
def test_what_is_no_number_of_worlds_is_refused(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_MAX_WORLDS", text)
    with pytest.raises(DocumentError, match="SIMYARD_MAX_WORLDS"):
        max_worlds_of_job()


def test_a_server_is_waited_for_as_long_as_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SIMYARD_SERVER_WAIT", raising=False)
    assert server_wait_s() == 90
    monkeypatch.setenv("SIMYARD_SERVER_WAIT", "5")
    assert server_wait_s() == 5
