"""docs/guide/search.md: its program runs, and finds failures; its words are those of the code."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from specs.data.episode import CONTROL_S
from specs.data.physics import CONTROL_DELAY, LEAST_FACTOR, MOST_FACTOR, OF_PEOPLE, PHYSICAL, RANGES
from specs.pipeline.document import PipelineSpec
from specs.pipeline.gate_section import Gate
from specs.pipeline.search_section import MAX_DISTINCT, MAX_SEARCHED, MIN_SEARCHED, Distribution, Search
from specs.pipeline.simulation_section import Matrix
from tasks.results.statistics.distinct_failures import OTHER_PLACE_M
from tests.repository import ROOT

DOCUMENT = (ROOT / "docs/guide/search.md").read_text()
(PROGRAM,) = re.findall(r"^```python\n(.*?)^```$", DOCUMENT, re.DOTALL | re.MULTILINE)


@pytest.mark.long
@pytest.mark.integration
def test_the_program_says_how_probable_a_failure_is_and_lists_some(tmp_path: Path):
    for name in ("applications", "examples"):
        shutil.copytree(ROOT / name, tmp_path / name)
    environment = {name: value for name, value in os.environ.items() if name != "SIMYARD_STORE"}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        cwd=tmp_path,
        env={**environment, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    sentence, *failures = done.stdout.splitlines()[-4:]
    assert re.match(
        r"fails with probability 0\.\d+ \(0\.\d+ to 0\.\d+\), by [\d,]+ episodes of plain draws: ", sentence
    )
    for line in failures:
        assert re.match(
            r"\w+ wgj-[0-9a-f]{16}/world-\d-\d \d+ \{'MAX_SPEED': '0\.\d+', 'ODOMETRY_SIGMA': '0\.\d+'\}", line
        )


def test_the_document_is_one():
    sections, physics = re.findall(r"^```yaml\n(.*?)^```$", DOCUMENT, re.DOTALL | re.MULTILINE)
    request = {"robotApplications": [], "simulationApplications": []}
    batch = {"matrix": {"worlds": ["a/b"], "environmentVariables": {"MAX_SPEED": ["0.5"], "ODOMETRY_SIGMA": ["0.05"]}}}
    document = {"name": "n", "simulationBatch": {**batch, "createSimulationJobRequests": [request]}}
    asked = yaml.safe_load(sections)
    assert Search.model_validate(asked["search"]).budget.episodes == 50_000
    assert Gate.model_validate(asked["gate"]).failureProbability
    assert [*PipelineSpec.findings({**document, **asked})] == []
    varied = yaml.safe_load(physics)
    assert [*Search.model_validate(varied["search"]).over] == [
        "robot.mass",
        "robot.friction",
        "robot.controlDelay_s",
    ]
    assert Matrix.model_validate(varied["simulationBatch"]["matrix"]).sweep == {
        "robot.mass": ("0.9", "1", "1.1"),
        "robot.controlDelay_s": ("0", "0.1"),
    }


def test_each_physical_parameter_and_its_bounds_are_named():
    assert re.findall(r"^\| `((?:robot|people|start|goals)\.\w+)` \|", DOCUMENT, re.MULTILINE) == [*PHYSICAL]
    assert f"| {LEAST_FACTOR:g} to {MOST_FACTOR:g}; 1 is what the `robot.xml` says, bit for bit |" in DOCUMENT
    for name in OF_PEOPLE:
        assert re.search(
            rf"^\| `{name}` \|.*\| {RANGES[name].least:g} to {RANGES[name].most:g} \|$", DOCUMENT, re.MULTILINE
        )
    late = RANGES[CONTROL_DELAY]
    assert f"| {late.least:g} to {late.most:g} s, in control steps of {CONTROL_S:g} s; 0 is no delay" in DOCUMENT


def test_each_argument_and_each_distribution_is_named():
    arguments = re.findall(r"^\| `(\w+)` \|", DOCUMENT, re.MULTILINE)
    assert arguments == list(Search.model_fields)
    for kind in Distribution.model_fields:
        assert f"`{kind}: " in DOCUMENT


def test_its_numbers_are_those_of_the_code():
    assert f"{MIN_SEARCHED:,} to {MAX_SEARCHED:,}" in DOCUMENT
    assert f"1 to {MAX_DISTINCT}; {Search(over={}).find.distinct} if left out" in DOCUMENT
    assert f"another place, up to {OTHER_PLACE_M:g} m" in DOCUMENT
    assert f"{Search(over={}).budget.episodes:,} if left out" in DOCUMENT
