"""Fleets and robots in the store: their records, the robots' desired states, and what robots report.

A fleet's record names its one active deployment. A robot's record names its fleet.
"""

import logging
import time
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import PurePosixPath

from pydantic import TypeAdapter, ValidationError

from specs.arn import ResourceKind, absence, parse_reference
from specs.errors import (
    DocumentError,
    ObjectExists,
    ObjectNotFound,
    ObjectTooBig,
    ResourceAlreadyExists,
    ResourceNotFound,
)
from specs.field_types import Architecture, RobotTagMap
from tasks.deploy.fleet.states import Desired, FleetRecord, Reported, RobotRecord, Withdrawn, read_listed
from tasks.storage.base.keys import desired_key, fleet_key, reported_key, robot_record_key
from tasks.storage.base.store import Store, encode_document, find_document, update
from tasks.storage.tags import Change

_FLEETS = "fleets"
_LOG = logging.getLogger(__name__)
_ROBOTS = "robots"
_RECORD = "record.json"
_ROBOT_TAGS = TypeAdapter[dict[str, str]](RobotTagMap)
TOO_BIG = "too big"
"""Stands for the etag of an object that was not read because of its size."""
NOTHING_ASKED = b"null"
"""A desired state that asks nothing of the robot (tasks.deploy.rollout.operator_commands)."""
MOST_BYTES = 1 << 20
"""More than any object of a robot has."""


def create_fleet(store: Store, name: str, tags: Mapping[str, str] | None = None) -> FleetRecord:
    """Returns the fleet of that name, made if there is none; an old one keeps its tags.

    Raises:
        DocumentError: The name is none.
    """
    record = FleetRecord(name=name, created_at_s=time.time(), tags=dict(tags or {}))
    # One whose deletion is not done yet is made anew.
    return update(store, fleet_key(name), FleetRecord, lambda found: found if found and not found.deleted else record)


def read_fleet(store: Store, reference: str, *, deleted: bool = False) -> FleetRecord:
    """Returns a fleet, by name or ARN; one that is being deleted only if asked for.

    Raises:
        ResourceNotFound: No such fleet.
        DocumentError: The reference is no fleet's.
    """
    found = find_document(store, fleet_key(fleet_name(reference)), FleetRecord)
    return _present_fleet(found, store, reference, deleted=deleted)


def change_fleet(
    store: Store, reference: str, step: Callable[[FleetRecord], FleetRecord], *, deleted: bool = False
) -> FleetRecord:
    """Returns a fleet after a change, written over exactly what was read.

    Args:
        store: Where it is.
        reference: Its name or ARN.
        step: Returns what it shall be; called again when another process was first.
        deleted: Whether it may be one that is being deleted.

    Raises:
        ResourceNotFound: No such fleet.
        DocumentError: The reference is no fleet's.
    """

    def changed(found: FleetRecord | None) -> FleetRecord:
        return step(_present_fleet(found, store, reference, deleted=deleted))

    return update(store, fleet_key(fleet_name(reference)), FleetRecord, changed)


def change_fleet_tags(store: Store, reference: str, change: Change) -> FleetRecord:
    """Returns a fleet after its tags were changed.

    Raises:
        ResourceNotFound: No such fleet.
        DocumentError: There would be too many.
    """
    return change_fleet(store, reference, lambda fleet: fleet.model_copy(update={"tags": change(fleet.tags)}))


def fleets(store: Store) -> list[FleetRecord]:
    """Returns all fleets, oldest first; one with a damaged record is left out, and named in the log."""
    found = [
        fleet for key in store.keys(_FLEETS) if (fleet := read_listed(store, key, FleetRecord, PurePosixPath(key).stem))
    ]
    return sorted((fleet for fleet in found if not fleet.deleted), key=lambda fleet: (fleet.created_at_s, fleet.name))


def fleet_name(reference: str) -> str:
    """Returns the name of the fleet that a plain name or an ARN refers to.

    Raises:
        ResourceNotFound: An ARN of something else.
    """
    return _named(reference, "deployment-fleet", _missing_fleet)


def _named(reference: str, kind: ResourceKind, missing: Callable[[str, str], ResourceNotFound]) -> str:
    try:
        parsed = parse_reference(reference)
    except ValueError as exc:
        raise missing(reference, str(exc)) from exc
    if parsed.kind not in {None, kind}:
        raise missing(reference, f"the name or ARN of a {kind}")
    return parsed.path


def _present_fleet(found: FleetRecord | None, store: Store, reference: str, *, deleted: bool) -> FleetRecord:
    if found is None:
        raise _missing_fleet(reference, absence(["deployment-fleet"], store.url))
    if found.deleted and not deleted:
        raise _missing_fleet(reference, f"a fleet in {store.url}; this one is being deleted")
    return found


def _missing_fleet(reference: str, allowed: str) -> ResourceNotFound:
    return ResourceNotFound.of("fleet", repr(reference), allowed)


def create_robot(
    store: Store,
    name: str,
    architecture: Architecture = "X86_64",
    tags: Mapping[str, str] | None = None,
    *,
    local: bool = False,
) -> RobotRecord:
    """Returns the robot of that name, made if there is none; an old one stays as it is.

    Args:
        store: Where robots are.
        name: The robot's.
        architecture: Its processor's.
        tags: Given to its applications as variables.
        local: Whether its agent is a process of a demonstration.

    Raises:
        DocumentError: The name is none.
    """
    record = RobotRecord(
        name=name, architecture=architecture, created_at_s=time.time(), tags=dict(tags or {}), local=local
    )
    try:
        return add_robot(store, record)
    except ResourceAlreadyExists:
        return read_robot(store, name)


def add_robot(store: Store, record: RobotRecord) -> RobotRecord:
    """Returns a robot that was not there before.

    Raises:
        ResourceAlreadyExists: There is one of that name.
        DocumentError: The name is none.
    """
    try:
        store.create(robot_record_key(record.name), encode_document(record))
    except ObjectExists as exc:
        raise ResourceAlreadyExists.of("name", repr(record.name), "a name that no robot has") from exc
    return record


def register_robot(store: Store, fleet: str, robot: str) -> RobotRecord:
    """Returns the robot as a member of the fleet.

    Raises:
        ResourceNotFound: No such fleet or robot.
        DocumentError: The robot belongs to another fleet; a robot has one (docs/reference/robomaker.md, section 8).
    """
    name = read_fleet(store, fleet).name

    def joined(record: RobotRecord) -> RobotRecord:
        if record.fleet and record.fleet != name:
            raise DocumentError.of("robot", record.name, f"a robot without a fleet; it is in {record.fleet}")
        return _with_fleet(record, name)

    changed = _change_robot(store, robot, joined)
    try:
        read_fleet(store, fleet)  # who deletes a fleet marks it first: one of the two sees the other
    except ResourceNotFound:
        deregister_robot(store, changed.name)
        raise
    return changed


def deregister_robot(store: Store, robot: str, fleet: str = "") -> RobotRecord:
    """Returns the robot as a member of no fleet; what it runs, it keeps running.

    Args:
        store: Where it is.
        robot: Its name or ARN.
        fleet: Name of the fleet that it must be in; empty for any or none.

    Raises:
        ResourceNotFound: No such robot, or it is not in that fleet.
    """

    def left(record: RobotRecord) -> RobotRecord:
        if fleet and record.fleet != fleet:
            raise _missing_robot(robot, f"a robot of the fleet {fleet}")
        return _with_fleet(record, "")

    return _change_robot(store, robot, left)


def change_robot_tags(store: Store, reference: str, change: Change) -> RobotRecord:
    """Returns a robot after its tags were changed; the next deployment to it gives them to its application.

    Raises:
        ResourceNotFound: No such robot.
        DocumentError: There would be too many, or one that cannot be a variable.
    """

    def tagged(record: RobotRecord) -> RobotRecord:
        try:
            tags = _ROBOT_TAGS.validate_python(change(record.tags))
        except ValidationError as exc:
            raise DocumentError.of("tags", "given", _reason(exc), source=record.name) from exc
        return record.model_copy(update={"tags": tags})

    return _change_robot(store, reference, tagged)


def read_robot(store: Store, reference: str) -> RobotRecord:
    """Returns a robot, by name or ARN.

    Raises:
        ResourceNotFound: No such robot.
        DocumentError: The name is none.
    """
    found = find_document(store, robot_record_key(robot_name(reference)), RobotRecord)
    return _present_robot(found, store, reference)


def _change_robot(store: Store, reference: str, step: Callable[[RobotRecord], RobotRecord]) -> RobotRecord:
    key = robot_record_key(robot_name(reference))
    return update(store, key, RobotRecord, lambda found: step(_present_robot(found, store, reference)))


def _present_robot(found: RobotRecord | None, store: Store, reference: str) -> RobotRecord:
    if found is None:
        raise _missing_robot(reference, absence(["robot"], store.url))
    return found


def _with_fleet(record: RobotRecord, fleet: str) -> RobotRecord:
    return record if record.fleet == fleet else record.model_copy(update={"fleet": fleet})


def known_robot(store: Store, name: str) -> RobotRecord | None:
    """Returns the robot of that name, or None.

    Raises:
        DocumentError: The name is none.
    """
    return find_document(store, robot_record_key(name), RobotRecord)


def robot_name(reference: str) -> str:
    """Returns the name of the robot that a plain name or an ARN refers to.

    Raises:
        ResourceNotFound: An ARN of something else.
    """
    return _named(reference, "robot", _missing_robot)


def robots(store: Store) -> list[RobotRecord]:
    """Returns all robots, oldest first.

    A robot with a damaged record is left out, and named in the log: its fleet is not known, so it is asked nothing.
    """
    found = [
        robot for name in _names(store) if (robot := read_listed(store, robot_record_key(name), RobotRecord, name))
    ]
    return sorted(found, key=lambda robot: (robot.created_at_s, robot.name))


def robot_count(store: Store) -> int:
    """Returns how many robots there are, without reading them."""
    return len(_names(store))


def members(store: Store, fleet: str) -> list[RobotRecord]:
    """Returns the robots of a fleet, oldest first: the order in which they are deployed to."""
    return [robot for robot in robots(store) if robot.fleet == fleet]


def read_desired(store: Store, robot: str) -> tuple[Desired | None, str]:
    """Returns what was asked of a robot last, and its etag; None and an empty text for nothing.

    An object that cannot be read asks nothing of the robot: the result is None, and its etag or ``TOO_BIG``.
    """
    key = desired_key(robot)
    try:
        stored = store.get(key, MOST_BYTES)
    except ObjectNotFound:
        return None, ""
    except ObjectTooBig as exc:
        _warn_once(robot, TOO_BIG, str(exc))
        return None, TOO_BIG
    if stored.body.strip() == NOTHING_ASKED or parse_withdrawn(stored.body):
        return None, stored.etag
    try:
        return Desired.model_validate_json(stored.body), stored.etag
    except ValidationError as exc:
        _warn_once(robot, stored.etag, f"{store.url}: {key}: {_reason(exc)}")
        return None, stored.etag


def read_reported(store: Store, robot: str) -> Reported | None:
    """Returns a robot's last report; None if there is none that can be read."""
    key = reported_key(robot)
    try:
        stored = store.get(key, MOST_BYTES)
    except ObjectNotFound:
        return None
    except ObjectTooBig as exc:
        _warn_once(robot, TOO_BIG, str(exc))
        return None
    try:
        return Reported.model_validate_json(stored.body)
    except ValidationError as exc:
        _warn_once(robot, stored.etag, f"{store.url}: {key}: {_reason(exc)}")
        return None


def parse_withdrawn(body: bytes) -> Withdrawn | None:
    """Returns what lies in the place of a desired state that was taken back, or None for anything else."""
    try:
        return Withdrawn.model_validate_json(body)
    except ValidationError:
        return None


def _names(store: Store) -> list[str]:
    return [key.split("/")[1] for key in store.keys(_ROBOTS) if key.endswith(f"/{_RECORD}")]


@lru_cache(maxsize=4096)
def _warn_once(robot: str, etag: str, what: str) -> None:
    """Logs, once, that an object of a robot is not what Simyard writes; the caller goes on without it."""
    _LOG.warning("%s is without news, what is written of it cannot be read (%s): %s", robot, etag, what)


def _reason(exc: ValidationError) -> str:
    return exc.errors(include_url=False, include_input=False)[0]["msg"]


def _missing_robot(reference: str, allowed: str) -> ResourceNotFound:
    return ResourceNotFound.of("robot", repr(reference), allowed)
