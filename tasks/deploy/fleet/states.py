"""The objects that the store holds for fleets, robots and roll-outs; each object has one writer.

A listing reads them one by one: a damaged record is logged once, and left out.
"""

import logging
from functools import lru_cache
from typing import Annotated, Literal, TypeVar

from pydantic import Field, ValidationError

from specs.base import Spec
from specs.errors import ObjectNotFound, ObjectTooBig
from specs.field_types import Architecture, S3Object
from specs.robomaker.deployment import DeploymentLaunchConfig, RobotDeploymentStep, RobotStatus
from specs.robomaker.failure_codes import DeploymentJobErrorCode
from tasks.storage.base.store import Store

MOST_SEQUENCE = 1 << 53
"""Milliseconds until the year 287,396; every JSON parser keeps whole numbers up to here as they are."""
MOST_TIMEOUT_S = 604_800.0  # docs/reference/robomaker.md, section 8: a week
MOST_CONDITION_BYTES = 16 << 20
_MOST_EPOCH = _MOST_VERSION = 1 << 31  # a claim that is taken over each second gets there in 68 years
# Until the year 5138: times that no clock shows, infinity and NaN among them, are none.
Seconds = Annotated[float, Field(ge=0, le=1e11)]
SequenceNumber = Annotated[int, Field(ge=1, le=MOST_SEQUENCE)]
Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
_Name = Annotated[str, Field(pattern=r"^[a-zA-Z0-9][a-zA-Z0-9_.\-]{0,254}$")]  # it is printed and logged
_LOG = logging.getLogger(__name__)
_MOST_BYTES = 1 << 20


# The controller of a deployment writes ``desired``, only the robot writes ``reported``, and everything else about a
# roll-out is computed from the two.
class FleetRecord(Spec):
    """A fleet.

    Attributes:
        deployment: Id of its last deployment job, which is active until that job's record is terminal; or empty.
        deleted: Whether it is being deleted, and hidden.
    """

    name: str
    created_at_s: Seconds
    tags: dict[str, str]
    deployment: str = ""
    deleted: bool = False


class RobotRecord(Spec):
    """A robot.

    Attributes:
        fleet: The one fleet it belongs to, or empty.
        local: Whether its agent is a process that a run of a pipeline starts for a demonstration.
        greengrass_group: What RoboMaker's call named as its Greengrass group: kept and answered, and used for nothing.
    """

    name: str
    architecture: Architecture
    created_at_s: Seconds
    tags: dict[str, str]
    fleet: str = ""
    local: bool = False
    greengrass_group: str = ""


class Signature(Spec):
    """An Ed25519 signature, and whose key made it."""

    keyid: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    value: Annotated[str, Field(pattern=r"^[0-9a-f]{128}$")]


class Desired(Spec):
    """What a robot shall run.

    Anybody who can write to the store can write it, and it is parsed before its signature is verified, so every number
    is bounded.

    Attributes:
        deployment: The job that wants it.
        sequence: When it was asked for in milliseconds since 1970, or one more than the desired state before it, if
            that is more (`tasks.deploy.rollout.controller`); a robot never goes back.
        epoch: Of the controller's claim on the job.
        digest: Of the bundle.
        environment: All variables that the application and its scripts get, tags included.
        condition: A script that decides whether the bundle is downloaded.
        timeout_s: How long the robot may take.
        issued_at_s: When it was asked for, by the controller's clock; seconds since 1970.
        expires_at_s: Until when a robot that verifies may begin with it; 0 where nothing is signed.
        condition_sha256: Of the condition's bytes when this was signed, or empty.
        signature: The deployer's, under everything else (`tasks.deploy.trust.signed_fleets`).
    """

    robot: _Name
    deployment: _Name
    sequence: SequenceNumber
    epoch: Annotated[int, Field(ge=1, le=_MOST_EPOCH)]
    application: _Name
    version: Annotated[int, Field(ge=1, le=_MOST_VERSION)]
    digest: Digest
    launch: DeploymentLaunchConfig
    environment: dict[str, str]
    condition: S3Object | None = None
    timeout_s: Annotated[float, Field(ge=0, le=MOST_TIMEOUT_S)]
    issued_at_s: Seconds
    expires_at_s: Seconds = 0.0
    condition_sha256: Annotated[str, Field(pattern=r"^([0-9a-f]{64})?$")] = ""
    signature: Signature | None = None


class Withdrawn(Spec):
    """Lies in the place of a desired state that was taken back before its robot had answered.

    Attributes:
        withdrawn: The sequence of that state; the next one's is higher.
    """

    withdrawn: SequenceNumber


class Reported(Spec):
    """How far a robot has come with a desired state.

    Anybody who can write to the store can write it, so every number that others compute with is bounded.

    Attributes:
        boot_id: Random, one for each start of the agent.
        percent_done: Of the download and extraction.
        running_digest: Of the bundle that runs now, or empty.
        is_up: Whether it does; false while it cannot be started.
        started_at_s: When the robot began, by its own clock; seconds since 1970.
        finished_at_s: When it ended, or 0 while it has not.
    """

    robot: str
    deployment: str
    sequence: Annotated[int, Field(ge=0, le=MOST_SEQUENCE)]
    boot_id: str
    status: Literal["Deploying", "InSync", "Failed"]
    step: RobotDeploymentStep
    percent_done: Annotated[float, Field(ge=0, le=100)] = 0.0
    failure_code: DeploymentJobErrorCode | None = None
    failure_reason: Annotated[str, Field(max_length=1024)] = ""
    running_digest: str = ""
    is_up: bool = True
    started_at_s: Seconds
    finished_at_s: Seconds = 0.0


class RobotProgress(Spec):
    """One robot in a deployment job's record, which RobotDeployment shows later.

    Attributes:
        runs: What it runs by its last report, such as ``courier 1`` or ``nothing``; empty where that was not looked up.
        started_at_s: When the robot was asked, or 0.
        finished_at_s: When it ended, or 0.
    """

    status: RobotStatus
    step: RobotDeploymentStep | None = None
    percent_done: float = 0.0
    failure_code: DeploymentJobErrorCode | None = None
    failure_reason: str = ""
    runs: str = ""
    started_at_s: float = 0.0
    finished_at_s: float = 0.0


WAITING = RobotProgress(status="Registered")


def progress_of(desired: Desired, reported: Reported | None, *, now_s: float) -> RobotProgress:
    """Returns how far a robot has come, from what was asked of it and what it says.

    Args:
        desired: What was asked.
        reported: Its latest report, if any; ignored when it answers something else.
        now_s: The controller's clock, seconds since 1970.
    """
    wanted = (desired.deployment, desired.sequence)
    answer = reported if reported and (reported.deployment, reported.sequence) == wanted else None
    if answer and answer.status != "Deploying":
        return _progress(answer, answer.status, desired)
    if now_s - desired.issued_at_s > desired.timeout_s:
        return RobotProgress(
            status="NoResponse",
            step=answer.step if answer else None,
            failure_code="RobotDeploymentNoResponse",
            failure_reason=f"not finished within {desired.timeout_s:g} s",
            started_at_s=desired.issued_at_s,
            finished_at_s=now_s,
        )
    if answer:
        return _progress(answer, "Deploying", desired)
    return RobotProgress(status="PendingNewDeployment", started_at_s=desired.issued_at_s)


def _progress(answer: Reported, status: RobotStatus, desired: Desired) -> RobotProgress:
    return RobotProgress(
        status=status,
        step=answer.step,
        percent_done=answer.percent_done,
        failure_code=answer.failure_code,
        failure_reason=answer.failure_reason,
        started_at_s=desired.issued_at_s,
        finished_at_s=answer.finished_at_s,
    )


_NOUNS = {FleetRecord: "fleet", RobotRecord: "robot"}
FleetOrRobot = TypeVar("FleetOrRobot", FleetRecord, RobotRecord)


def read_listed(store: Store, key: str, kind: type[FleetOrRobot], name: str) -> FleetOrRobot | None:
    """Returns the record under a key that a listing gave; None if it is gone, or is not what Simyard writes there.

    Args:
        store: Where it is.
        key: Its key.
        kind: What it is the record of.
        name: What the key calls the fleet or robot.
    """
    try:
        stored = store.get(key, _MOST_BYTES)
    except ObjectNotFound:  # deleted since it was listed
        return None
    except ObjectTooBig as exc:
        _warn_of_record(_NOUNS[kind], name, "", str(exc))
        return None
    try:
        record = kind.model_validate_json(stored.body)
    except ValidationError as exc:
        reason = exc.errors(include_url=False, include_input=False)[0]["msg"]
        _warn_of_record(_NOUNS[kind], name, stored.etag, f"{store.url}: {key}: {reason}")
        return None
    if record.name != name:
        _warn_of_record(_NOUNS[kind], name, stored.etag, f"{store.url}: {key} is the record of {record.name!r}")
        return None
    return record


@lru_cache(maxsize=4096)
def _warn_of_record(noun: str, name: str, etag: str, what: str) -> None:
    """Logs, once, that a record is not what Simyard writes."""
    _LOG.warning(
        "%s %s is left out, its record cannot be read (%s): %s; delete it to make it anew", noun, name, etag, what
    )
