"""The script that decides whether a bundle is downloaded."""

import pytest

from specs.field_types import S3Object
from tasks.storage.buckets import open_bucket
from tests.deploy.one_robot import GOOD, OneRobot


def _condition(one: OneRobot, script: str) -> tuple[S3Object, str]:
    bucket = open_bucket(one.yard.store, "conditions")
    return S3Object(bucket="conditions", key="ready.sh"), bucket.put("ready.sh", script.encode())


@pytest.mark.parametrize(
    ("script", "code"), [("#!/bin/sh\n", None), ("#!/bin/sh\nexit 1\n", "DownloadConditionFailed")]
)
def test_the_download_condition_decides_before_the_download(script: str, code: str | None, one: OneRobot) -> None:
    condition, _ = _condition(one, script)

    reported = one.deploy(one.yard.publish(GOOD), 1, condition=condition)

    assert reported.failure_code == code
    assert (reported.status == "InSync") == any((one.root / "versions").iterdir())


def test_a_download_condition_with_another_etag_is_not_run(one: OneRobot) -> None:
    condition, etag = _condition(one, '#!/bin/sh\ntouch "$HOME/ran"\n')
    pinned = condition.model_copy(update={"etag": "0" * len(etag)})

    reported = one.deploy(one.yard.publish(GOOD), 1, condition=pinned)

    assert reported.failure_code == "EtagMismatch"
    assert not (one.root / "ran").exists()
    assert (
        one.deploy(one.yard.publish(GOOD), 2, condition=condition.model_copy(update={"etag": etag})).status == "InSync"
    )
