"""Which sequence the owner gives next, whatever somebody has written to the store."""

from pathlib import Path

import pytest

from tasks.deploy.fleet.fleet_registry import read_desired
from tasks.deploy.fleet.states import MOST_SEQUENCE, Desired, Withdrawn
from tasks.deploy.rollout.controller import ask_robot
from tasks.storage.base.keys import desired_key, reported_key
from tasks.storage.base.store import encode_document
from tests.deploy.one_robot import GOOD, NAME, desired
from tests.deploy.trust.signed_fleet import Owner
from tests.deploy.yard import Yard

NOW_S = 1_700_000_000.0


@pytest.fixture
def owner(yard: Yard, tmp_path: Path) -> Owner:
    return Owner(yard.store, tmp_path / "keys")


def _ask(yard: Yard, owner: Owner, deployment: str, now_s: float = NOW_S) -> Desired:
    wanted = desired(yard.publish(GOOD), 1, deployment=deployment, issued_at_s=now_s)
    return ask_robot(yard.store, wanted, owner.signer.sign, own=owner.signer.is_own)


def test_the_sequence_is_the_time_in_milliseconds(yard: Yard, owner: Owner) -> None:
    assert _ask(yard, owner, "one").sequence == NOW_S * 1000


def test_a_clock_that_was_set_back_still_gives_a_higher_sequence(yard: Yard, owner: Owner) -> None:
    first = _ask(yard, owner, "one")

    assert _ask(yard, owner, "two", NOW_S - 86_400).sequence == first.sequence + 1


def test_a_clock_that_goes_on_gives_a_higher_sequence_though_the_last_state_was_deleted(
    yard: Yard, owner: Owner
) -> None:
    first = _ask(yard, owner, "one")
    yard.store.delete(desired_key(NAME))

    assert _ask(yard, owner, "two", NOW_S + 1).sequence > first.sequence


@pytest.mark.parametrize("sequence", [5, 1 << 52, MOST_SEQUENCE])
@pytest.mark.parametrize("deployment", ["forged", "two"])
def test_a_state_that_the_owner_did_not_sign_is_written_over_and_its_numbers_do_not_count(
    sequence: int, deployment: str, yard: Yard, owner: Owner
) -> None:
    first = _ask(yard, owner, "one")
    forged = first.model_copy(update={"sequence": sequence, "deployment": deployment, "epoch": 1 << 30})
    yard.store.put(desired_key(NAME), encode_document(forged))

    second = _ask(yard, owner, "two", NOW_S + 1)

    assert second.sequence == (NOW_S + 1) * 1000
    assert read_desired(yard.store, NAME)[0] == second


def test_what_another_robot_was_asked_does_not_count(yard: Yard, owner: Owner) -> None:
    wanted = desired(yard.publish(GOOD), 1, robot="r2", deployment="one", issued_at_s=NOW_S)
    other = ask_robot(yard.store, wanted, owner.signer.sign, own=owner.signer.is_own)
    yard.store.put(desired_key(NAME), encode_document(other))

    assert _ask(yard, owner, "one").robot == NAME


@pytest.mark.parametrize("body", [b'{"sequence": 9007199254740992}', b'{"sequence": %s}' % (b"9" * 4300)])
def test_a_report_does_not_count(body: bytes, yard: Yard, owner: Owner) -> None:
    yard.store.put(reported_key(NAME), body)

    assert _ask(yard, owner, "one").sequence == NOW_S * 1000


def test_a_withdrawal_that_nobody_signed_does_not_count_where_things_are_signed(yard: Yard, owner: Owner) -> None:
    yard.store.put(desired_key(NAME), encode_document(Withdrawn(withdrawn=1 << 52)))

    assert _ask(yard, owner, "one").sequence == NOW_S * 1000


@pytest.mark.parametrize("sequence", [MOST_SEQUENCE - 1, MOST_SEQUENCE])
def test_a_fleet_without_keys_is_asked_too_when_somebody_has_used_up_the_numbers(sequence: int, yard: Yard) -> None:
    wanted = desired(yard.publish(GOOD), 1, deployment="two", issued_at_s=NOW_S)
    forged = wanted.model_copy(update={"sequence": sequence, "deployment": "forged"})
    yard.store.put(desired_key(NAME), encode_document(forged))

    assert ask_robot(yard.store, wanted).sequence in {MOST_SEQUENCE, NOW_S * 1000}
