"""The signature under a desired state: Ed25519 over its canonical JSON, by the deployer's key."""

from collections.abc import Mapping

from securesystemslib.exceptions import UnverifiedSignatureError, VerificationError

from specs.digest import canonical_json
from specs.errors import TrustRefused
from tasks.deploy.fleet.states import Desired, Signature
from tasks.deploy.trust.tuf_names import CryptoSigner, Key, RawSignature

# The same key signs metadata, which is JSON: with this in front, one can never be taken for the other.
_PREFIX = b"simyard desired state 1\n"


def sign_desired(desired: Desired, signer: CryptoSigner) -> Desired:
    """Returns the desired state with a signature under it."""
    made = signer.sign(payload(desired))
    return desired.model_copy(update={"signature": Signature(keyid=made.keyid, value=made.signature)})


def verify(desired: Desired, keys: Mapping[str, Key]) -> None:
    """Does nothing for a desired state that one of the keys has signed as it stands.

    Args:
        desired: What was asked of a robot.
        keys: The deployer's, by id.

    Raises:
        TrustRefused: It is not signed, by another key, or was changed.
    """
    signature = desired.signature
    if signature is None:
        raise TrustRefused("it is not signed; deploy with the keys that this robot trusts (SIMYARD_KEYS)")
    key = keys.get(signature.keyid)
    if key is None:
        who = f"{signature.keyid[:16]}, which is not the deployer's key any more, or never was"
        raise TrustRefused(f"it is signed by {who}; deploy again with the keys that this robot trusts")
    try:
        key.verify_signature(RawSignature(signature.keyid, signature.value), payload(desired))
    except (UnverifiedSignatureError, VerificationError) as exc:
        raise TrustRefused("it was changed after it was signed; find out who writes to the store") from exc


def payload(desired: Desired) -> bytes:
    """Returns the bytes that are signed.

    What has its default is left out: a robot whose Simyard is newer, and knows more fields, finds the same bytes.

    Raises:
        TrustRefused: It holds what no desired state that was signed can hold, such as an infinite number.
    """
    document = desired.model_dump(mode="json", exclude={"signature"}, exclude_defaults=True)
    try:
        return _PREFIX + canonical_json(document)
    except ValueError as exc:
        raise TrustRefused(f"it cannot have been signed: {exc}") from exc
