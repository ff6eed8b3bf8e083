"""The robots of examples/robots: each is read as its guide says, and delivers in furnished apartments."""

import re
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from flows.pipeline.references import resolve_references
from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from tasks.documents.pipeline_file import read_pipeline
from tasks.simulate.engines.engine_table import choose_engine
from tasks.simulate.plan.chunks import plan_chunks
from tasks.storage.store_url import open_store
from tests.factories.simulations import DELIVERY, FOLDERS, REPOSITORY, SCENARIO, cluttered, simulate_lanes

ROBOTS = REPOSITORY / "examples" / "robots"
GUIDE = (REPOSITORY / "docs" / "guide" / "robots.md").read_text()
LAUNCHES = {
    "differential": ("differential", "follow"),
    "skid-steer": ("skid_steer", "follow"),
    "holonomic": ("holonomic", "glide"),
}
ENGINES = {
    "differential": ("planar", "the fastest of all"),
    "skid-steer": ("mujoco", "its wheels turn"),
    "holonomic": ("planar", "the fastest of all"),
}
SEEDS, LANES = 2, 8


def test_there_is_a_document_for_each_and_the_guide_has_them_all():
    assert sorted(path.stem for path in ROBOTS.glob("*.yaml")) == sorted(LAUNCHES)
    for name in LAUNCHES:
        assert f"examples/robots/{name}.yaml" in GUIDE
        assert f"examples/robots/{name}/robot.xml" in GUIDE


@pytest.mark.parametrize("name", LAUNCHES)
def test_the_engine_is_the_one_that_the_guide_names_and_for_its_reason(name: str):
    choice = choose_engine("auto", ROBOTS / name / "robot.xml", "jax", "cpu")
    engine, reason = ENGINES[name]
    assert choice.engine == engine
    assert choice.why == reason or "joint 'front_left'" in choice.why
    assert re.search(rf"\| `{name}` \|.*\| `{engine}`: {reason}", GUIDE)


@pytest.mark.parametrize("name", LAUNCHES)
def test_the_guide_explains_each_element_of_its_file(name: str):
    explained = set(re.findall(r"^\| `<(\w+)", GUIDE, re.MULTILINE))
    elements = {each.tag for each in ET.parse(ROBOTS / name / "robot.xml").iter()} - {"mujoco"}  # noqa: S314 - our own
    assert elements <= explained


@pytest.mark.parametrize("name", LAUNCHES)
def test_its_document_names_what_is_there(name: str, tmp_path: Path):
    spec = read_pipeline(ROBOTS / f"{name}.yaml")
    resolve_references(spec, open_store(tmp_path.as_uri()), ROBOTS)
    assert spec.simulationBatch is not None
    (request,) = spec.simulationBatch.createSimulationJobRequests
    assert request.robotApplications is not None
    launch = request.robotApplications[0].launchConfig
    assert (launch.packageName, launch.launchFile) == LAUNCHES[name]


def rows(name: str) -> list[EpisodeResult]:
    """Returns deliveries of a robot in two furnished apartments."""
    package, launch = LAUNCHES[name]
    robot = ApplicationLaunch(name=name, version="1", digest="7" * 64, package=package, launch_file=launch)
    worlds = {f"hand/apartment-{seed}": cluttered(seed) for seed in range(2)}
    requests = [
        EpisodeRequest(
            index=index, world=world, seed=seed, robot=robot, scenario=SCENARIO, environment={}, duration_s=90.0
        )
        for index, (world, seed) in enumerate((world, seed) for world in worlds for seed in range(SEEDS))
    ]
    (chunk,) = plan_chunks(requests, LANES)
    bundles = {robot.digest: ROBOTS / name, DELIVERY: FOLDERS[DELIVERY]}
    return simulate_lanes(chunk, worlds, bundles, lanes=LANES, should_stop=lambda: False)


@pytest.mark.long
@pytest.mark.parametrize("name", LAUNCHES)
def test_it_delivers_among_furniture_and_keeps_clear_of_it(name: str):
    delivered = rows(name)
    assert [row.failure_reason for row in delivered] == [""] * len(delivered)
    assert {(row.engine, row.outcome, row.collisions) for row in delivered} == {(ENGINES[name][0], "Passed", 0)}
    assert all(row.min_clearance_m > 0.0 for row in delivered)
    assert min(row.spl or 0.0 for row in delivered) > 0.7
