"""Whatever lies in the place of a desired state or of metadata: the agent lives, and its application runs on."""

import json
from collections.abc import Iterator
from itertools import count
from random import Random
from shutil import rmtree

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from specs.robomaker.bundle import Version
from specs.robomaker.deployment import DeploymentLaunchConfig
from tasks.deploy.fleet.fleet_registry import read_desired
from tasks.deploy.fleet.states import Desired
from tasks.deploy.robot.agent import Poll, serve
from tasks.deploy.robot.processes import Stop, StopRequested
from tasks.deploy.trust.keyring import CryptoSigner
from tasks.deploy.trust.signed_fleets import sign_desired
from tasks.storage.base.keys import desired_key
from tasks.storage.base.store import encode_document
from tests.deploy.one_robot import GOOD, NAME, OneRobot, desired
from tests.deploy.robot.spoiled import BIG_BYTES, spoil
from tests.deploy.trust.signed_fleet import NEWER, CarefulRobot, Owner
from tests.deploy.yard import Yard, marked_by

_ANY_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)
_COUNT = count(1)
_EXAMPLES = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
_TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)


class Attacker(Stop):
    """Writes the next object whenever the agent waits, and requests the stop when there is none.

    Attributes:
        alive: After how many of them the agent looked again, and the application was the same process.
    """

    def __init__(self, robot: CarefulRobot, objects: Iterator[tuple[str, bytes, bytes]]) -> None:
        super().__init__()
        self.alive = 0
        self._robot = robot
        self._objects = objects
        self._before: list[int] = []
        self._restore: tuple[str, bytes] | None = None

    def sleep(self, seconds: float) -> None:  # noqa: ARG002 - it does not wait
        store = self._robot.yard.store
        self._before = self._before or marked_by(self._robot.folder)
        if self._restore:
            self.alive += marked_by(self._robot.folder) == self._before != []
            store.put(*self._restore)
        key, body, good = next(self._objects, ("", b"", b""))
        if not key:
            raise StopRequested
        self._restore = (key, good)
        store.put(key, body)
        if key != desired_key(NAME):  # so that it needs all metadata again, and has something to verify
            rmtree(self._robot.folder / "trust", ignore_errors=True)
            found, _ = read_desired(store, NAME)
            assert found
            store.put(desired_key(NAME), encode_document(found.model_copy(update={"sequence": found.sequence + 1})))


def _spoiled(
    owner: Owner, careful: CarefulRobot, versions: list[Version], size: int
) -> Iterator[tuple[str, bytes, bytes]]:
    """Yields objects that the owner did not write so: their key, their bytes, and what lay there."""
    dice, thief, key = Random(size), CryptoSigner.generate_ed25519(), desired_key(NAME)  # noqa: S311 - what is spoiled
    store = careful.yard.store
    mine, others = owner.signed(versions[1], 5), owner.signed(versions[1], 5, robot="r2")
    states = [
        others,
        others.model_copy(update={"robot": NAME}),
        mine.model_copy(update={"sequence": 1 << 52}),
        mine.model_copy(update={"signature": None}),
        sign_desired(mine.model_copy(update={"signature": None}), thief),
        careful.disk.load().running or mine,
    ]
    metadata = sorted(owner.metadata())
    for number in range(size):
        if number % 400 == 7:
            yield key, b" " * BIG_BYTES, b"null"
        elif number % 4 == 0:
            place = dice.choice(metadata)
            good = store.get(place).body
            store.put(key, encode_document(states[2]))
            yield place, spoil(good, dice), good
        else:
            yield key, spoil(encode_document(dice.choice(states)), dice), b"null"


@pytest.mark.parametrize("size", [40, pytest.param(2000, marks=[pytest.mark.soak, pytest.mark.timeout(900)])])
def test_spoiled_states_and_metadata_end_neither_the_agent_nor_its_application(
    size: int, yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    versions = [installed, yard.publish(NEWER)]
    careful.robot.end()
    careful = CarefulRobot(yard, owner.root)  # as after a start
    attacker = Attacker(careful, _spoiled(owner, careful, versions, size))
    with pytest.raises(StopRequested):
        serve(careful.robot, yard.store, NAME, attacker, Poll(0.0, 0.0, Random(1)))  # noqa: S311 - jitter

    runs = careful.runs
    careful.robot.end()
    assert f"{attacker.alive} of {size}" == f"{size} of {size}"
    assert runs == (installed.digest, 1)


@_EXAMPLES
@given(field=st.sampled_from(sorted(Desired.model_fields)), value=_ANY_JSON)
def test_a_field_of_any_value_is_refused_or_is_no_state(
    field: str, value: object, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    document = json.loads(encode_document(owner.signed(installed, 2)))
    same = document[field] == value
    careful.yard.store.put(desired_key(NAME), json.dumps({**document, field: value}).encode())
    found, _ = read_desired(careful.yard.store, NAME)

    if found and not same:
        careful.robot.accept(found)

    assert careful.disk.load().sequence == 1
    assert careful.runs == (installed.digest, 1)


@pytest.mark.long
@_EXAMPLES
@given(name=st.sampled_from(["timestamp.json", "snapshot.json", "targets.json", "deployer.json"]), data=st.data())
def test_metadata_of_any_values_is_refused(
    name: str, data: st.DataObject, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    key = owner.latest(name.removesuffix(".json"))
    good = careful.yard.store.get(key).body
    document = json.loads(good)
    signed = document["signed"]
    signed[data.draw(st.sampled_from(sorted(signed)))] = data.draw(_ANY_JSON)
    rmtree(careful.folder / "trust", ignore_errors=True)
    careful.yard.store.put(key, json.dumps(document).encode())

    careful.robot.accept(desired(installed, 2))

    careful.yard.store.put(key, good)
    assert careful.disk.load().sequence == 1
    assert careful.runs == (installed.digest, 1)


@settings(_EXAMPLES, max_examples=15)
@given(
    script=st.text(st.characters(exclude_categories=["Cs", "Cc", "Zl", "Zp"]), min_size=1, max_size=8),
    environment=st.dictionaries(_TEXTS, _TEXTS, max_size=3),
    launch_file=st.sampled_from(["run.sh", "..", ".", "-", "none"]),
)
def test_whatever_an_accepted_state_holds_the_agent_reports_how_it_went(
    script: str, environment: dict[str, str], launch_file: str, one: OneRobot
) -> None:
    version, sequence = one.yard.publish(GOOD), next(_COUNT)
    launch = DeploymentLaunchConfig(packageName="courier", launchFile=launch_file, preLaunchFile=script)

    one.robot.accept(desired(version, sequence, environment=environment, launch=launch))

    outcome = one.robot._disk.load().outcome
    assert outcome is not None
    assert outcome.sequence == sequence


def test_a_check_that_fails_in_any_way_ends_no_agent_at_its_start(
    yard: Yard, owner: Owner, careful: CarefulRobot, installed: Version
) -> None:
    state = careful.disk.load()
    careful.disk.save(state.model_copy(update={"target": owner.signed(installed, 2), "sequence": 2}))
    careful.robot.end()
    careful = CarefulRobot(yard, owner.root)
    careful.robot._check = _fails

    careful.robot.recover()

    runs = careful.runs
    careful.robot.end()
    assert runs == (installed.digest, 1)


def _fails(_desired: Desired) -> int:
    raise RecursionError("too deep")
