"""Episodes with people: the same rows alone and among others, and what the robot's meetings with them become."""

import pytest

from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.data.people import People
from specs.data.world import World
from tasks.simulate.plan.chunks import plan_chunks
from tests.factories.simulations import FOLDERS, delivery, pushing, simulate_lanes
from tests.simulate.conftest import Simulate

LANES = 8
PEOPLE_COLUMNS = tuple(name for name in EpisodeResult.model_fields if "person" in name)


def among_people(asked: EpisodeRequest) -> EpisodeRequest:
    return asked.model_copy(update={"people": People(count=3, unaware=0.5)})


STILL = [pushing(k, world=f"hand/pen-{k % 3}", seed=k, duration_s=12.0) for k in range(LANES)]
WALKING = [among_people(request) for request in STILL]


@pytest.fixture(scope="module")
def together(push: Simulate) -> list[EpisodeResult]:
    return push(WALKING)


@pytest.mark.parametrize("position", [0, 5])
def test_an_episode_with_people_alone_has_the_row_that_it_has_among_others(
    push: Simulate, together: list[EpisodeResult], position: int
):
    assert push([WALKING[position]]) == [together[position]]


def test_a_robot_that_does_not_look_runs_into_people(together: list[EpisodeResult]):
    met = [row for row in together if row.person_contacts]
    assert met
    for row in met:
        assert row.min_person_m is not None
        assert row.min_person_m < 0.01
        assert row.person_contact_m_s is not None
        assert row.person_contact_m_s > 0.0
        assert row.impulse_ns > 0.0
    for row in together:
        assert row.person_personal_s is not None
        assert row.person_intimate_s is not None
        assert row.person_personal_s >= row.person_intimate_s >= 0.0


def test_episodes_without_people_say_nothing_of_them_and_are_as_they_are_beside_others(push: Simulate):
    alone = push(STILL)
    assert {getattr(row, name) for row in alone for name in PEOPLE_COLUMNS} == {None}
    mixed = push([STILL[0], WALKING[1], STILL[2], *WALKING[3:]])
    assert [mixed[0], mixed[2]] == [alone[0], alone[2]]


def test_a_world_without_room_for_people_fails_its_episode_alone(push: Simulate, pens: dict[str, World]):
    full = WALKING[0].model_copy(update={"people": People(count=8), "world": "hand/pen-0"})
    first, second = push([full, WALKING[1]])
    assert (first.status, first.failure_code) == ("Failed", "InvalidInput")
    assert "has room for" in first.failure_reason
    assert second.status == "Completed"


@pytest.mark.long
def test_the_courier_among_people_drives_the_same_bits_alone_and_among_others(apartments: dict[str, World]):
    asked = [among_people(delivery(k, world=f"hand/apartment-{k % 4}", seed=k, duration_s=60.0)) for k in range(LANES)]

    def driven(requests: list[EpisodeRequest]) -> list[EpisodeResult]:
        (chunk,) = plan_chunks(requests, LANES)
        return simulate_lanes(chunk, apartments, FOLDERS, lanes=LANES, should_stop=lambda: False)

    together = driven(asked)
    assert driven(asked[3:4]) == [together[3]]
    assert {row.status for row in together} == {"Completed"}
    assert all(row.min_person_m is not None and row.min_person_m < 10.0 for row in together)


def test_an_episodes_own_variables_say_what_its_people_are_like(push: Simulate, together: list[EpisodeResult]):
    own = {"people.count": "2", "people.speed_ms": "0.6", "people.unaware": "1"}
    varied = [each.model_copy(update={"environment": {**each.environment, **own}}) for each in WALKING[:4]]
    people = People(count=2, speed_ms=0.6, unaware=1.0)
    asked = [each.model_copy(update={"people": people}) for each in WALKING[:4]]
    found = push([*varied, *WALKING[4:]])
    assert found == [*push(asked), *together[4:]]
    assert found[:4] != together[:4]
