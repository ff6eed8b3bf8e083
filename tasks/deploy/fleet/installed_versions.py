"""The version that each robot runs now, as the robot itself reports it."""

import time
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache

from specs.errors import ObjectNotFound
from specs.robomaker.bundle import Application
from tasks.deploy.fleet.robots import read_desired, read_reported
from tasks.deploy.fleet.states import Desired, progress_of
from tasks.storage.base.encoding import decode_document
from tasks.storage.base.keys import application_key, reported_key
from tasks.storage.base.store import Store


@dataclass(frozen=True)
class RobotNow:
    """A robot that was asked for something, as it is now.

    Attributes:
        deployment: Id of the job that asked it last.
        status: As RoboMaker names it.
        why: What went wrong, or empty.
        runs: Such as ``courier 3``, or ``nothing``, as it reported last.
        reported_s: When that was, by the store's clock; None if it never did.
    """

    name: str
    deployment: str
    status: str
    why: str
    runs: str
    reported_s: float | None


def robots_now(store: Store, names: Iterable[str]) -> list[RobotNow]:
    """Returns how those of the named robots are that were ever asked for something, in the same order."""

    @cache  # as many as this call's robots have applications
    def versions(application: str) -> dict[str, int]:
        return _versions(store, application)

    found: list[RobotNow] = []
    for name in names:
        desired, _ = read_desired(store, name)
        if desired is None:
            continue
        reported = read_reported(store, name)
        now = progress_of(desired, reported, now_s=time.time())
        digest = reported.running_digest if reported else ""
        numbers = {**versions(desired.application), desired.digest: desired.version}
        runs = _version_text(desired, digest, numbers.get(digest))
        found.append(RobotNow(name, desired.deployment, now.status, now.failure_reason, runs, _reported_s(store, name)))
    return found


def _reported_s(store: Store, robot: str) -> float | None:
    try:
        return store.entry(reported_key(robot)).written_s
    except ObjectNotFound:
        return None


def _version_text(desired: Desired, digest: str, number: int | None) -> str:
    if not digest:
        return "nothing"
    return f"{desired.application} {number}" if number else f"bundle {digest[:12]}"


def _versions(store: Store, application: str) -> dict[str, int]:
    """Returns the number of each version of a robot application, by the digest of each of its bundles."""
    key = application_key("robot-application", application)
    try:
        record = decode_document(Application, store.get(key), store, key)
    except ObjectNotFound:
        return {}
    return {
        digest: version.number for version in record.versions for digest in (version.digest, *version.digests.values())
    }
