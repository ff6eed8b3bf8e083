"""What is in force for whom, whatever an owner does, and however long; and the signature under a desired state."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.errors import TrustRefused
from specs.robomaker.deployment import DeploymentLaunchConfig
from tasks.deploy.fleet.states import Desired, Signature
from tasks.deploy.trust.keyring import CryptoSigner, TargetFile, Targets
from tasks.deploy.trust.metadata import MOST_METADATA_BYTES
from tasks.deploy.trust.signed_fleets import (
    FIELD,
    MOST_IN_FORCE,
    MOST_REMEMBERED,
    SignedFleets,
    payload,
    read_fleets,
    sign_desired,
    verify_desired,
    write_fleets,
)
from tests.deploy.yard import desired_state

_TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
_NAMES = st.from_regex(r"[a-zA-Z0-9][a-zA-Z0-9_.\-]{0,7}", fullmatch=True)
_DESIRED = st.builds(
    Desired,
    robot=_NAMES,
    deployment=_NAMES,
    sequence=st.integers(1, 2**40),
    epoch=st.integers(1, 9),
    application=_NAMES,
    version=st.integers(1, 40),
    digest=st.text("0123456789abcdef", min_size=64, max_size=64),
    launch=st.builds(
        DeploymentLaunchConfig,
        packageName=st.just("courier"),
        launchFile=st.sampled_from(["run.sh", "go"]),
        preLaunchFile=st.sampled_from([None, "before.sh"]),
        postLaunchFile=st.none(),
        environmentVariables=st.none(),
    ),
    environment=st.dictionaries(_TEXTS, _TEXTS, max_size=2),
    condition=st.none(),
    timeout_s=st.floats(0, 604_800),
    issued_at_s=st.floats(0, 1e10),
    expires_at_s=st.floats(0, 1e10),
    condition_sha256=st.just(""),
    signature=st.none(),
)
_SIGNER = CryptoSigner.generate_ed25519()
_KEYS = {_SIGNER.public_key.keyid: _SIGNER.public_key}
_DIGEST, _OTHER = "a" * 64, "b" * 64
_BEGUN = SignedFleets().enlisted("couriers", ["r1", "r2"]).begun("couriers", "dep-1", [_DIGEST])
_DEPLOYMENTS = st.sampled_from([f"dep-{number}" for number in range(6)])
_STEP = st.tuples(
    st.sampled_from(["begin", "follow", "withdraw", "move"]), st.sampled_from(["couriers", "keepers"]), _DEPLOYMENTS
)


@pytest.mark.long
@given(_DESIRED)
def test_what_was_signed_is_verified_also_after_a_way_through_the_store(desired: Desired) -> None:
    stored = sign_desired(desired, _SIGNER).model_dump_json()

    verify_desired(Desired.model_validate_json(stored), _KEYS)


@given(_DESIRED, _DESIRED)
def test_a_signature_fits_one_desired_state_alone(one: Desired, other: Desired) -> None:
    signature = sign_desired(one, _SIGNER).signature

    if one == other:
        assert payload(one) == payload(other)
    else:
        with pytest.raises(TrustRefused, match="changed after it was signed"):
            verify_desired(other.model_copy(update={"signature": signature}), _KEYS)


@given(_DESIRED, st.data())
def test_one_field_of_another_is_found_out(desired: Desired, data: st.DataObject) -> None:
    field = data.draw(st.sampled_from(sorted(set(Desired.model_fields) - {"signature"})))
    other = data.draw(_DESIRED)
    changed = sign_desired(desired, _SIGNER).model_copy(update={field: getattr(other, field)})

    if getattr(other, field) != getattr(desired, field):
        with pytest.raises(TrustRefused):
            verify_desired(changed, _KEYS)


def test_another_key_is_refused_also_under_the_name_of_the_right_one() -> None:
    thief = CryptoSigner.generate_ed25519()
    evil = sign_desired(desired_state(), thief)
    assert evil.signature is not None
    disguised = Signature(keyid=_SIGNER.public_key.keyid, value=evil.signature.value)

    with pytest.raises(TrustRefused, match="not the deployer's key"):
        verify_desired(evil, _KEYS)
    with pytest.raises(TrustRefused, match="changed after it was signed"):
        verify_desired(evil.model_copy(update={"signature": disguised}), _KEYS)


def test_numbers_that_json_does_not_have_were_never_signed() -> None:
    evil = sign_desired(desired_state(), _SIGNER).model_copy(update={"timeout_s": float("nan")})

    with pytest.raises(TrustRefused, match="cannot have been signed"):
        verify_desired(evil, _KEYS)


def _desired(robot: str = "r1", deployment: str = "dep-1", digest: str = _DIGEST) -> Desired:
    return desired_state(robot=robot, deployment=deployment, digest=digest)


def test_what_is_in_force_for_the_robots_fleet_is_accepted() -> None:
    _BEGUN.admit(_desired())


@pytest.mark.parametrize(
    ("fleets", "wanted", "says"),
    [
        (_BEGUN, _desired(deployment="dep-2"), "'dep-2' is not in force in 'couriers'"),
        (_BEGUN, _desired(digest=_OTHER), "not on the deployer's signed list for 'couriers'"),
        (_BEGUN, _desired(robot="r3"), "'r3' is in no fleet that a key vouches for"),
        (_BEGUN.dismissed({"r1"}), _desired(), "'r1' is in no fleet"),
        (_BEGUN.enlisted("keepers", ["r1"]), _desired(), "'dep-1' is not in force in 'keepers'"),
        (_BEGUN.withdrawn("dep-1"), _desired(), "withdrawn, or superseded; simyard fleet sync couriers"),
        (_BEGUN.begun("couriers", "dep-2", [_DIGEST]), _desired(), "withdrawn, or superseded"),
        (_BEGUN.dissolved("couriers"), _desired(), "'r1' is in no fleet"),
    ],
)
def test_what_is_not_in_force_for_the_robots_fleet_is_refused(fleets: SignedFleets, wanted: Desired, says: str) -> None:
    with pytest.raises(TrustRefused, match=says):
        fleets.admit(wanted)


def test_a_sync_leaves_in_force_what_it_brings_to_more_robots() -> None:
    synced = _BEGUN.followed("couriers", "dep-2", "dep-1", [_DIGEST])

    synced.admit(_desired())
    synced.admit(_desired("r2", "dep-2"))


def test_a_sync_of_what_was_withdrawn_is_refused() -> None:
    with pytest.raises(TrustRefused, match="'dep-1' is not in force in 'couriers': it was canceled, or superseded"):
        _BEGUN.withdrawn("dep-1").followed("couriers", "dep-2", "dep-1", [_DIGEST])


def test_with_a_deployment_its_syncs_are_withdrawn_and_a_sync_alone() -> None:
    synced = _BEGUN.followed("couriers", "dep-2", "dep-1", [_DIGEST])

    assert synced.withdrawn("dep-1").known("couriers").deployments == []
    assert synced.withdrawn("dep-2").known("couriers").deployments == ["dep-1"]


def test_what_was_withdrawn_never_begins_again() -> None:
    with pytest.raises(TrustRefused, match="'dep-1' was withdrawn, and stays so"):
        _BEGUN.withdrawn("dep-1").begun("couriers", "dep-1", [_DIGEST])


def test_a_withdrawal_says_until_when_an_old_copy_counts() -> None:
    fleets = _BEGUN.replacing(1000.0).withdrawn("dep-1")

    assert (fleets.ends_s("dep-1"), fleets.ends_s("dep-2")) == (1000, None)
    assert fleets.replacing(500.0).until_s == 1000, "an older copy may be accepted for longer than the last one"


def test_robots_of_whom_nobody_has_signed_that_they_belong_to_the_fleet_are_named() -> None:
    with pytest.raises(TrustRefused, match=r"no key vouches that 'r3', 'r4' belong.*simyard fleet vouch couriers"):
        _BEGUN.require_members("couriers", ["r1", "r3", "r4"])
    _BEGUN.require_members("couriers", ["r1", "r2"])


def test_it_does_not_grow_with_the_number_of_deployments() -> None:
    fleets = _BEGUN
    for number in range(2, 300):
        last = fleets.known("couriers").deployments[-1]
        deployment = f"dep-{number}"
        if number < 200:
            fleets = fleets.begun("couriers", deployment, [f"{number:064}"])
        else:
            fleets = fleets.followed("couriers", deployment, last, [f"{199:064}"])

    couriers = fleets.known("couriers")
    assert len(couriers.deployments) == MOST_IN_FORCE
    assert couriers.deployments[0] == "dep-199"
    assert couriers.deployments[-1] == "dep-299"
    assert len(couriers.withdrawn) == MOST_REMEMBERED
    assert len(couriers.digests) == 1


def test_thousands_of_robots_fit_many_times() -> None:
    robots = [f"robot-{number:06}" for number in range(10_000)]

    document = _BEGUN.enlisted("couriers", robots).model_dump_json()

    assert len(document) * 10 < MOST_METADATA_BYTES


def test_metadata_lists_no_bundle_that_nothing_in_force_brings() -> None:
    deployer = Targets()
    for digest in (_DIGEST, _OTHER):
        deployer.targets[f"bundles/{digest}"] = TargetFile(1, {"sha256": digest}, f"bundles/{digest}")

    write_fleets(deployer, _BEGUN)

    assert list(deployer.targets) == [f"bundles/{_DIGEST}"]
    assert read_fleets(deployer) == _BEGUN


def test_metadata_that_says_nothing_of_fleets_names_none_and_of_a_newer_simyard_no_less() -> None:
    deployer = Targets()
    assert read_fleets(deployer) == SignedFleets()
    deployer.unrecognized_fields[FIELD] = {**_BEGUN.model_dump(mode="json"), "newer": 1}
    assert read_fleets(deployer) == _BEGUN
    deployer.unrecognized_fields[FIELD] = {"robots": 1}
    with pytest.raises(TrustRefused, match="cannot be read: install a newer Simyard"):
        read_fleets(deployer)


@given(st.lists(_STEP, max_size=20))
def test_whatever_is_withdrawn_stays_so(steps: list[tuple[str, str, str]]) -> None:
    fleets, gone = SignedFleets().enlisted("couriers", ["r1"]), set[tuple[str, str]]()
    for step, fleet, deployment in steps:
        before = {name: list(each.deployments) for name, each in fleets.fleets.items()}
        try:
            fleets = _take(fleets, step, fleet, deployment)
        except TrustRefused:
            continue
        for name, deployments in before.items():
            gone |= {(name, each) for each in deployments if each not in fleets.known(name).deployments}
        assert not {(name, each) for name, known in fleets.fleets.items() for each in known.deployments} & gone
        assert len({name for name, known in fleets.fleets.items() if known.deployments}) <= 2


def _take(fleets: SignedFleets, step: str, fleet: str, deployment: str) -> SignedFleets:
    if step == "begin":
        return fleets.begun(fleet, deployment, [_DIGEST])
    if step == "follow":
        last = next(iter(fleets.known(fleet).deployments), "none")
        return fleets.followed(fleet, deployment, last, [_DIGEST])
    return fleets.withdrawn(deployment) if step == "withdraw" else fleets.enlisted(fleet, ["r1"])
