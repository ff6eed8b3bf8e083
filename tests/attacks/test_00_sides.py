"""What the attacks stand on: a writer who reaches the whole store, and nothing else."""

import pytest
from botocore.exceptions import ClientError

from tests.attacks.bucket_writer import BucketWriter
from tests.attacks.conftest import Owner, Writer
from tests.servers.seaweed import Seaweed


def test_the_writer_reads_and_writes_every_object_of_the_store(owner: Owner, writer: Writer) -> None:
    assert owner.simyard("fleet", "create", "couriers").returncode == 0
    (key,) = writer.keys("fleets/")
    body = writer.get(key)
    writer.delete(key)
    assert "couriers" not in owner.simyard("list", "fleets").stdout
    writer.put(key, body)
    assert "couriers" in owner.simyard("list", "fleets").stdout


def test_the_writer_reaches_no_other_bucket(seaweed: Seaweed, attacked_bucket: str) -> None:
    seaweed.make_bucket("another")
    with pytest.raises(ClientError, match="AccessDenied"):
        BucketWriter(seaweed, "another", "any").put("key", b"body")
