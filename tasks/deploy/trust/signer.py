"""Signs a deployment: its bundle, its plan, and the desired state of each robot."""

import hashlib
import tempfile
from datetime import datetime
from pathlib import Path
from typing import Literal

from securesystemslib.exceptions import UnverifiedSignatureError, VerificationError

from specs.errors import DocumentError, TrustRefused
from specs.field_types import S3Object
from tasks.deploy.fleet.states import MOST_CONDITION_BYTES, Desired, Signature
from tasks.deploy.trust.keyring import ROOT_FILE, Keyring, keyring
from tasks.deploy.trust.repository import Clock, init_keys, list_for_deployment, open_repository, utc_now
from tasks.deploy.trust.signature import sign_desired, verify
from tasks.deploy.trust.trust_choice import chosen_keys, trust_faults
from tasks.deploy.trust.tuf_names import CryptoSigner, RawSignature
from tasks.storage.archives import digest_of
from tasks.storage.base.cache_folder import cache_folder
from tasks.storage.base.keys import bundle_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.store_url import store_id

# The same key signs metadata and desired states: with this in front, one can never be taken for the other.
_PLAN_PREFIX = b"simyard deployment plan 1\n"
# A robot that comes back later than that is brought up to date by deploying again.
_DESIRED_LIFETIME_S = 30 * 86_400.0


class DeploymentSigner:
    """Signs with the deployer's key in a folder.

    Args:
        store: What the keys are for.
        ring: The keys.
        clock: Tells the time.
    """

    def __init__(self, store: Store, ring: Keyring, clock: Clock = utc_now) -> None:
        self._store = store
        self._ring = ring
        self._clock = clock
        self._key: CryptoSigner | None = None
        self._conditions: dict[tuple[str, str], str] = {}

    @property
    def root_of_trust(self) -> Path:
        """The file that robots are given when their agent is installed."""
        return self._ring.folder / ROOT_FILE

    def admit(self, digest: str) -> None:
        """Puts the bundle with that digest on the list of what robots accept, after a look at its bytes.

        Raises:
            TrustRefused: The store's metadata or bundle is not what it was, or has expired.
            DocumentError: A key is not here.
            StoreError: The store fails.
        """
        length = _length(self._store, digest)
        with open_repository(self._store, self._ring, clock=self._clock) as session:
            self._key = self._ring.get("deployer", session.state.keyids("deployer"))
            list_for_deployment(session, digest, length)

    def sign(self, desired: Desired) -> Desired:
        """Returns what is asked of a robot with an expiry date, the digest of its condition, and a signature."""
        change: dict[str, object] = {"expires_at_s": _seconds(self._clock()) + _DESIRED_LIFETIME_S}
        if desired.condition:
            change["condition_sha256"] = self._condition_sha256(desired.condition)
        return sign_desired(desired.model_copy(update=change), self._deployer)

    def is_own(self, desired: Desired) -> bool:
        """Returns whether the deployer has signed a desired state as it stands; what a replaced key signed is not."""
        key = self._deployer.public_key
        try:
            verify(desired, {key.keyid: key})
        except TrustRefused:
            return False
        return True

    def sign_plan(self, plan: bytes) -> Signature:
        """Returns a signature under what a deployment is going to do."""
        made = self._deployer.sign(_PLAN_PREFIX + plan)
        return Signature(keyid=made.keyid, value=made.signature)

    def check_plan(self, plan: bytes, signature: Signature) -> None:
        """Does nothing for a plan that this deployer has signed.

        Raises:
            TrustRefused: It is not, or was changed.
        """
        key = self._deployer.public_key
        if signature.keyid != key.keyid:
            raise TrustRefused("the plan is signed by another key than the deployer's; make a new deployment")
        try:
            key.verify_signature(RawSignature(signature.keyid, signature.value), _PLAN_PREFIX + plan)
        except (UnverifiedSignatureError, VerificationError) as exc:
            what = "the plan was changed after it was signed"
            raise TrustRefused(f"{what}; find out who writes to the store, and make a new deployment") from exc

    @property
    def _deployer(self) -> CryptoSigner:
        if self._key is None:
            with open_repository(self._store, self._ring, clock=self._clock) as session:
                self._key = self._ring.get("deployer", session.state.keyids("deployer"))
        return self._key

    def _condition_sha256(self, condition: S3Object) -> str:
        known = (condition.bucket, condition.key)
        if known not in self._conditions:
            body = open_bucket(self._store, condition.bucket).get(condition.key, MOST_CONDITION_BYTES).body
            self._conditions[known] = hashlib.sha256(body).hexdigest()
        return self._conditions[known]


def open_signer(store: Store, folder: Path) -> DeploymentSigner:
    """Returns what signs with the keys in a folder.

    Raises:
        DocumentError: There is no such folder, or it lies in the store.
    """
    return DeploymentSigner(store, keyring(folder, store))


def local_signer(store: Store) -> DeploymentSigner:
    """Returns what signs for a fleet of this machine; its keys are made when they are missing, in the cache.

    Whoever loses the cache loses no robot: the agents of such a fleet are given the root of trust at every start.
    """
    folder = cache_folder() / "keys" / store_id(store)
    return DeploymentSigner(store, init_keys(store, folder))


def chosen_signer(store: Store, trust: Literal["signed", "unsigned"], *, local: bool) -> DeploymentSigner | None:
    """Returns what vouches for a deployment: the keys in SIMYARD_KEYS, else those of this machine for its own robots.

    None for a deployment that shall be unsigned.

    Args:
        store: What is signed for.
        trust: What was asked for.
        local: Whether the robots are agents that this process starts.

    Raises:
        DocumentError: There are no keys.
    """
    if faults := trust_faults(trust=trust, local=local):
        raise DocumentError(faults)
    keys = chosen_keys()
    if trust == "unsigned":
        return None
    return open_signer(store, keys) if keys else local_signer(store)


def _length(store: Store, digest: str) -> int:
    with tempfile.TemporaryDirectory() as folder:
        archive = Path(folder) / "bundle"
        store.download(bundle_key(digest), archive)
        if digest_of(archive) != digest:
            raise TrustRefused(f"{store.url}: {bundle_key(digest)} was changed; publish the application again")
        return archive.stat().st_size


def _seconds(now: datetime) -> float:
    return now.timestamp()
