"""Worlds that a template does not give are found, whoever wrote them, before anything is shipped."""

import hashlib

import pytest

from specs.robomaker.world_jobs import CreateWorldGenerationJobRequest
from tasks.worlds.job.generation_job import world_changes
from tasks.worlds.job.production import Order, make
from tests.worlds.templates import sample

ORDER = Order(template=sample("default-two-rooms"), seed=7, generation="wgj-1", robot_radius_m=0.17)
REQUEST = CreateWorldGenerationJobRequest.model_validate(
    {"template": "arn:t", "worldCount": {"floorplanCount": 2, "interiorCountPerFloorplan": 1}}
)
NAMES = ["wgj-1/world-1-1", "wgj-1/world-2-1"]


@pytest.fixture(scope="module")
def digests() -> dict[str, str]:
    made = [make(ORDER, (plan, 1)).document.encode() for plan in (1, 2)]
    return {name: hashlib.sha256(body).hexdigest() for name, body in zip(NAMES, made, strict=True)}


def test_the_worlds_of_a_template_are_found_unchanged(digests: dict[str, str]):
    assert world_changes(ORDER, REQUEST, NAMES, digests) == []


def test_a_world_that_was_put_there_is_named(digests: dict[str, str]):
    (line,) = world_changes(ORDER, REQUEST, NAMES, digests | {NAMES[1]: "0" * 64})
    assert line == f"world {NAMES[1]} has the SHA-256 {'0' * 64}; the template gives {digests[NAMES[1]]}"


def test_a_world_that_was_left_out_is_named(digests: dict[str, str]):
    (line,) = world_changes(ORDER, REQUEST, NAMES[:1], digests)
    assert line == f"world {NAMES[1]} has the SHA-256 none; the template gives {digests[NAMES[1]]}"


@pytest.mark.parametrize("worlds", [NAMES[::-1], [NAMES[0]] * 2, [*NAMES, "wgj-2/world-1-1"]])
def test_worlds_that_nobody_asked_for_are_refused(worlds: list[str], digests: dict[str, str]):
    (line,) = world_changes(ORDER, REQUEST, worlds, digests)
    assert line.startswith("the record of wgj-1 names worlds that it was not asked for: [")


def test_of_many_worlds_some_are_drawn(digests: dict[str, str]):
    assert len(world_changes(ORDER, REQUEST, [], digests, most=1)) == 1
