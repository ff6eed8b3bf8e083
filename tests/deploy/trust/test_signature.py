"""The signature under a desired state covers all of it."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.errors import TrustRefused
from specs.robomaker.deployment import DeploymentLaunchConfig
from tasks.deploy.fleet.states import Desired, Signature
from tasks.deploy.trust.keyring import CryptoSigner
from tasks.deploy.trust.signed_fleets import payload, sign_desired, verify_desired

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
    evil = sign_desired(_example(), thief)
    assert evil.signature is not None
    disguised = Signature(keyid=_SIGNER.public_key.keyid, value=evil.signature.value)

    with pytest.raises(TrustRefused, match="not the deployer's key"):
        verify_desired(evil, _KEYS)
    with pytest.raises(TrustRefused, match="changed after it was signed"):
        verify_desired(evil.model_copy(update={"signature": disguised}), _KEYS)


def test_numbers_that_json_does_not_have_were_never_signed() -> None:
    evil = sign_desired(_example(), _SIGNER).model_copy(update={"timeout_s": float("nan")})

    with pytest.raises(TrustRefused, match="cannot have been signed"):
        verify_desired(evil, _KEYS)


def _example() -> Desired:
    return Desired(
        robot="r1",
        deployment="dep-1",
        sequence=1,
        epoch=1,
        application="courier",
        version=1,
        digest="0" * 64,
        launch=DeploymentLaunchConfig(packageName="courier", launchFile="run.sh"),
        environment={},
        timeout_s=5.0,
        issued_at_s=0.0,
    )
