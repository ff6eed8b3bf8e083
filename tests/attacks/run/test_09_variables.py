"""A version passes with the variables that it was driven with, and robots get those."""

from collections.abc import Mapping
from pathlib import Path

import pytest

from tests.attacks.conftest import Owner
from tests.attacks.run.small_robots import bundle, document, publish

pytestmark = [pytest.mark.integration, pytest.mark.long]
_REFUSED = 2
CASES: Mapping[str, tuple[Mapping[str, str], Mapping[str, str]]] = {
    "another value": ({"SPEED": "0.5"}, {"SPEED": "9"}),
    "none": ({"SPEED": "0.5"}, {}),
    "one that no episode has": ({}, {"SPEED": "9"}),
}


@pytest.mark.parametrize("case", CASES)
def test_what_passed_at_half_speed_does_not_ship_at_another(owner: Owner, tmp_path: Path, case: str):
    """The owner's deployment sets another SPEED than her simulation, or none, or is the only one that sets it.

    A variable that robots get otherwise than episodes is named by the document, with the reason, or is its fault:
    refused before anything runs.
    """
    simulated, deployed = CASES[case]
    ran = tmp_path / "ran"
    publish(owner, str(bundle(tmp_path / "own", ran)))

    ended = owner.simyard("run", document(owner, simulated=simulated, deployed=deployed))

    assert not ran.exists(), f"the robot runs with SPEED {ran.read_text().strip()!r}"
    assert ended.returncode == _REFUSED, ended.stdout
    assert "launchConfig.environmentVariables.SPEED" in ended.stdout
