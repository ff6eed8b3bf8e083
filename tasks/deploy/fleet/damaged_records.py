"""Reads records of fleets and robots for a listing; a damaged record is logged once, and left out."""

import logging
from functools import lru_cache
from typing import TypeVar

from pydantic import ValidationError

from specs.errors import ObjectNotFound, ObjectTooBig
from tasks.deploy.fleet.states import FleetRecord, RobotRecord
from tasks.storage.base.store import Store

_LOG = logging.getLogger(__name__)
_MOST_BYTES = 1 << 20
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
        _warn_once(_NOUNS[kind], name, "", str(exc))
        return None
    try:
        record = kind.model_validate_json(stored.body)
    except ValidationError as exc:
        reason = exc.errors(include_url=False, include_input=False)[0]["msg"]
        _warn_once(_NOUNS[kind], name, stored.etag, f"{store.url}: {key}: {reason}")
        return None
    if record.name != name:
        _warn_once(_NOUNS[kind], name, stored.etag, f"{store.url}: {key} is the record of {record.name!r}")
        return None
    return record


@lru_cache(maxsize=4096)
def _warn_once(noun: str, name: str, etag: str, what: str) -> None:
    """Logs, once, that a record is not what Simyard writes."""
    _LOG.warning(
        "%s %s is left out, its record cannot be read (%s): %s; delete it to make it anew", noun, name, etag, what
    )
