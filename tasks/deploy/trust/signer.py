"""Signs a deployment: its bundle, its plan, and the desired state of each robot."""

import hashlib
import logging
import tempfile
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from datetime import datetime, timedelta
from pathlib import Path
from typing import Literal

from securesystemslib.exceptions import UnverifiedSignatureError, VerificationError

from specs.errors import DocumentError, TrustRefused
from specs.field_types import S3Object
from tasks.deploy.fleet.states import MOST_CONDITION_BYTES, Desired, Signature
from tasks.deploy.trust.keyring import ROLES, ROOT_FILE, CryptoSigner, Keyring, RawSignature, Role, keyring
from tasks.deploy.trust.metadata import bundle_target, list_bundle
from tasks.deploy.trust.repository import (
    Clock,
    Session,
    init_keys,
    open_repository,
    read_repository,
    refresh_metadata,
    renew_metadata,
    utc_now,
)
from tasks.deploy.trust.signed_fleets import SignedFleets, read_fleets, sign_desired, verify_desired, write_fleets
from tasks.deploy.trust.trust_record import Admission, chosen_keys, condition_fault, trust_faults
from tasks.storage.archives import digest_of
from tasks.storage.base.keys import bundle_key
from tasks.storage.base.local_files import cache_folder
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.store_url import store_id

_LOG = logging.getLogger(__name__)
_LOOK_AGAIN = timedelta(minutes=10)
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
        self._fresh_until: datetime | None = None
        self._conditions: dict[tuple[str, str], str] = {}

    @property
    def root_of_trust(self) -> Path:
        """The file that robots are given when their agent is installed."""
        return self._ring.folder / ROOT_FILE

    def admit(self, wanted: Admission) -> None:
        """Puts a deployment in force, and its bundles on the list of what robots accept, after a look at their bytes.

        Writes nothing where robots accept it already, and will for a while.

        Raises:
            TrustRefused: The store's metadata or a bundle is not what it was, or has expired; or no key vouches for a
                robot; or the deployment was withdrawn.
            DocumentError: A key is not here.
            StoreError: The store fails.
        """
        lengths = {digest: _length(self._store, digest) for digest in wanted.digests}
        with self._open() as session:
            self._key = self._ring.get("deployer", session.state.keyids("deployer"))
            deployer, before = session.state.deployer.signed, _fleets(session)
            after = before.enlisted(wanted.fleet, wanted.own)
            after.require_members(wanted.fleet, wanted.robots)
            if wanted.follows:
                after = after.followed(wanted.fleet, wanted.deployment, wanted.follows, wanted.digests)
            else:
                after = after.begun(wanted.fleet, wanted.deployment, wanted.digests)
            listed = all(bundle_target(digest) in deployer.targets for digest in lengths)
            if listed and after == before and not any(session.due(role) for role in ROLES):
                return
            for digest, length in lengths.items():
                list_bundle(deployer, digest, length)
            write_fleets(deployer, after)
            _renew_in_time(session)

    def require_members(self, fleet: str, robots: Sequence[str]) -> None:
        """Does nothing for robots that belong to the fleet by what was signed.

        Raises:
            TrustRefused: They do not; says the command to run.
        """
        self.fleets().require_members(fleet, robots)

    def require_in_force(self, fleet: str, deployment: str) -> None:
        """Does nothing for a deployment that is in force in the fleet.

        Raises:
            TrustRefused: It was withdrawn, or superseded.
        """
        self.fleets().require_in_force(fleet, deployment)

    def fleets(self) -> SignedFleets:
        """Returns what is signed of fleets now."""
        return read_fleets(read_repository(self._store, self._ring).deployer.signed)

    def withdraw(self, deployment: str) -> int | None:
        """Has robots accept a deployment no more; those that have begun with it go on.

        Returns until when a robot that has seen nothing newer may accept it, if somebody puts the old metadata back,
        in seconds since 1970; None for a deployment that these keys never put in force, or long ago.
        """
        with self._open() as session:
            before = _fleets(session)
            after = before.withdrawn(deployment)
            if after != before:
                write_fleets(session.state.deployer.signed, after)
                session.commit(["deployer"])
            return after.ends_s(deployment)

    def sign_fleets(self, change: Callable[[SignedFleets], SignedFleets]) -> None:
        """Signs a change of who belongs to which fleet; writes nothing for none."""
        with self._open() as session:
            before = _fleets(session)
            after = change(before)
            if after != before:
                write_fleets(session.state.deployer.signed, after)
                session.commit(["deployer"])

    def renew(self) -> Sequence[Role]:
        """Keeps the signed metadata from expiring; returns what is due, and whose key is not here.

        Looks into the store only when something may be due: others may have renewed it meanwhile.
        """
        if self._fresh_until is not None and self._clock() < self._fresh_until:
            return ()
        with self._open() as session:
            due = refresh_metadata(session)
            lacking = session.state.expires("timestamp") - session.lifetimes["timestamp"] / 2
            self._fresh_until = max(lacking, self._clock() + _LOOK_AGAIN)
        return due

    def _open(self) -> AbstractContextManager[Session]:
        return open_repository(self._store, self._ring, clock=self._clock)

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
            verify_desired(desired, {key.keyid: key})
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
            with self._open() as session:
                self._key = self._ring.get("deployer", session.state.keyids("deployer"))
        return self._key

    def _condition_sha256(self, condition: S3Object) -> str:
        """Returns the SHA-256 of the script that the document names by its ETag.

        Raises:
            TrustRefused: It names none, or another one lies there: whoever writes to the bucket would have it signed.
        """
        known = (condition.bucket, condition.key)
        if known not in self._conditions:
            found = open_bucket(self._store, condition.bucket).get(condition.key, MOST_CONDITION_BYTES)
            if fault := condition_fault(condition, found.etag):
                raise TrustRefused(str(fault))
            self._conditions[known] = hashlib.sha256(found.body).hexdigest()
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
    return DeploymentSigner(store, init_keys(store, _local_folder(store), in_cache=True))


def signers_here(store: Store) -> list[DeploymentSigner]:
    """Returns what signs with the keys that this machine has for a store: those of SIMYARD_KEYS, and of the cache."""
    folders = [folder for folder in (chosen_keys(), _local_folder(store)) if folder and (folder / ROOT_FILE).is_file()]
    rings = [keyring(folder, store) for folder in folders]
    return [DeploymentSigner(store, ring) for ring in rings if ring.notes and ring.notes.store == store_id(store)]


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


def _fleets(session: Session) -> SignedFleets:
    """Returns what is signed of fleets, and will be replaced now."""
    found = read_fleets(session.state.deployer.signed)
    return found.replacing(session.state.expires("timestamp").timestamp())


def _renew_in_time(session: Session) -> None:
    """Signs everything anew, and warns of what only root's or targets' key can renew.

    Raises:
        TrustRefused: Such a part has expired.
    """
    due = renew_metadata(session)
    for role in due:
        _LOG.warning(
            "%s expires at %s, and its key is not here: simyard fleet keys renew", role, session.state.expires(role)
        )
    expired = [role for role in due if session.state.expires(role) <= session.now]
    if expired:
        raise TrustRefused(f"{' and '.join(expired)} expired; bring their keys and run simyard fleet keys renew")


def _local_folder(store: Store) -> Path:
    return cache_folder() / "keys" / store_id(store)


def _length(store: Store, digest: str) -> int:
    with tempfile.TemporaryDirectory() as folder:
        archive = Path(folder) / "bundle"
        store.download(bundle_key(digest), archive)
        if digest_of(archive) != digest:
            raise TrustRefused(f"{store.url}: {bundle_key(digest)} was changed; publish the application again")
        return archive.stat().st_size


def _seconds(now: datetime) -> float:
    return now.timestamp()
