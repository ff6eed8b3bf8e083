"""The download condition: a script that decides on each robot whether it downloads the bundle.

See docs/reference/robomaker.md, section 8: exit 0 proceeds.
"""

import hashlib

from specs.errors import DocumentError
from specs.field_types import S3Object
from tasks.deploy.fleet.states import MOST_CONDITION_BYTES, Desired
from tasks.deploy.robot.install import Patience, StepFailed, retry
from tasks.deploy.robot.launch import LaunchPlace, run_program
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket


def ask_condition(store: Store, place: LaunchPlace, desired: Desired, condition: S3Object, patience: Patience) -> None:
    """Runs the condition; returns when it allows the download.

    Args:
        store: Where buckets are.
        place: Where programs run.
        desired: What the robot shall run.
        condition: The script.
        patience: What goes on meanwhile.

    Raises:
        StepFailed: It exits with another code than 0, is not there, or is not the one with the ETag.
        StopRequested: The agent has to end.
    """
    script = place.disk.downloads / f"{desired.sequence:06d}-condition"

    def download() -> None:
        stored = open_bucket(store, condition.bucket).get(condition.key, MOST_CONDITION_BYTES)
        if condition.etag and condition.etag.strip('"') != stored.etag.strip('"'):
            raise StepFailed("EtagMismatch", f"{condition.key} has ETag {stored.etag}, not {condition.etag}")
        if desired.condition_sha256 not in {"", hashlib.sha256(stored.body).hexdigest()}:
            raise StepFailed("EtagMismatch", f"{condition.key} was changed after the deployment was signed")
        script.write_bytes(stored.body)

    try:
        retry(download, desired, patience)
    except DocumentError as exc:
        raise StepFailed("DownloadConditionFailed", str(exc)) from exc
    script.chmod(0o755)  # for the account that programs run under
    try:
        run_program(place, desired, script, "condition", "DownloadConditionFailed")
    finally:
        script.unlink()
