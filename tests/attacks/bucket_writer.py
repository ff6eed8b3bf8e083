"""An identity of the S3 server that may do everything in one bucket, by that bucket's policy, and nothing elsewhere."""

import json
import time
from typing import Any

import botocore.session
from botocore.exceptions import ClientError

from tests.servers.seaweed import ATTACKER, ATTACKER_KEY, ATTACKER_SECRET, Seaweed

_WRITER = f"arn:aws:iam::000000000000:user/{ATTACKER}"
_POLICY_S = 30.0


class BucketWriter:
    """Writes into a bucket store with keys of its own."""

    def __init__(self, server: Seaweed, bucket: str, prefix: str) -> None:
        self._client = _client(server, ATTACKER_KEY, ATTACKER_SECRET)
        self._bucket, self._prefix = bucket, prefix

    def get(self, key: str) -> bytes:
        """Returns an object's bytes."""
        try:
            return self._client.get_object(Bucket=self._bucket, Key=self._full(key))["Body"].read()
        except ClientError as exc:
            if exc.response["Error"]["Code"] not in {"NoSuchKey", "404"}:
                raise
            raise KeyError(key) from exc

    def put(self, key: str, body: bytes) -> None:
        """Writes an object."""
        self._client.put_object(Bucket=self._bucket, Key=self._full(key), Body=body)

    def delete(self, key: str) -> None:
        """Removes an object."""
        self._client.delete_object(Bucket=self._bucket, Key=self._full(key))

    def keys(self, prefix: str) -> list[str]:
        """Returns the keys of all objects below a prefix."""
        pages = self._client.get_paginator("list_objects_v2").paginate(Bucket=self._bucket, Prefix=self._full(prefix))
        cut = len(self._full(""))
        return sorted(item["Key"][cut:] for page in pages for item in page.get("Contents", ()))

    def _full(self, key: str) -> str:
        return f"{self._prefix}/{key}"


def allow_writer(server: Seaweed, bucket: str) -> None:
    """Makes a bucket with a policy that lets the writer do everything in it."""
    server.make_bucket(bucket)
    here = f"arn:aws:s3:::{bucket}"
    may = {"Effect": "Allow", "Principal": {"AWS": [_WRITER]}, "Action": ["s3:*"], "Resource": [here, f"{here}/*"]}
    policy = {"Version": "2012-10-17", "Statement": [may]}
    owner = server.environment()
    client = _client(server, owner["AWS_ACCESS_KEY_ID"], owner["AWS_SECRET_ACCESS_KEY"])
    client.put_bucket_policy(Bucket=bucket, Policy=json.dumps(policy))
    _await_policy(BucketWriter(server, bucket, "policy"))


def _await_policy(writer: BucketWriter) -> None:
    """Returns when the server knows the policy, which it does a moment after it has taken it."""
    end_s = time.monotonic() + _POLICY_S
    while True:
        try:
            writer.put("known", b"known")
        except ClientError:
            if time.monotonic() > end_s:
                raise
            time.sleep(0.1)
        else:
            return


def _client(server: Seaweed, key: str, secret: str) -> Any:  # noqa: ANN401 - botocore makes its clients' classes as they are asked for
    return botocore.session.Session().create_client(
        "s3",
        region_name="us-east-1",
        endpoint_url=server.endpoint,
        aws_access_key_id=key,
        aws_secret_access_key=secret,
    )
