"""What lies in a bucket, and since when by the server's clock."""

from collections.abc import Iterator, Mapping
from datetime import datetime
from email.utils import parsedate_to_datetime
from typing import cast

from tasks.storage.backends.s3_client import Answer, S3Client
from tasks.storage.base.store import Entry


def list_objects(client: S3Client, bucket: str, prefix: str, folder: str) -> Iterator[Entry]:
    """Yields the objects below a folder as the server lists them, a thousand in a request.

    Args:
        client: Talks to the server.
        bucket: Whose objects.
        prefix: Of the store, which its keys do not begin with.
        folder: The prefix with what follows it.
    """
    page: dict[str, object] = {}
    while True:
        answer = client.call("list_objects_v2", Bucket=bucket, Prefix=folder, **page)
        for found in cast("list[Answer]", answer.get("Contents", [])):
            yield entry_of(cast("str", found["Key"]).removeprefix(prefix), found, "Size")
        if not answer.get("IsTruncated"):
            return
        page = {"ContinuationToken": answer["NextContinuationToken"]}


def list_uploads(client: S3Client, bucket: str, prefix: str, folder: str) -> list[Entry]:
    """Returns the uploads in parts that have not come to their end; sizes would cost a request each, and are 0.

    Args:
        client: The connection.
        bucket: The bucket.
        prefix: The store's place in the bucket.
        folder: The folder of the store that is listed.
    """
    found: list[Entry] = []
    page: dict[str, object] = {}
    while True:
        answer = client.call("list_multipart_uploads", Bucket=bucket, Prefix=folder, **page)
        for upload in cast("list[Answer]", answer.get("Uploads", [])):
            key = cast("str", upload["Key"])
            if key.startswith(folder):  # some servers list more than they are asked for
                began_s = _second(upload["Initiated"])
                found.append(Entry(key.removeprefix(prefix), 0, began_s, cast("str", upload["UploadId"])))
        if not answer.get("IsTruncated"):
            return sorted(found, key=lambda entry: (entry.key, entry.mark))
        page = {"KeyMarker": answer["NextKeyMarker"], "UploadIdMarker": answer["NextUploadIdMarker"]}


def entry_of(key: str, answer: Answer, size_field: str) -> Entry:
    """Returns an object from what the server tells of it in a listing, or when it is asked for it alone."""
    return Entry(key, cast("int", answer[size_field]), _second(answer["LastModified"]), object_mark(answer))


def object_mark(answer: Answer) -> str:
    """Returns an object's ETag and the second of its last write, the same from a listing and from asking for it."""
    return f"{answer['ETag']}-{_second(answer['LastModified']):.0f}"


def server_now_s(client: S3Client, bucket: str, prefix: str) -> float:
    """Returns the time by the server's clock, in whole seconds, from the head of an answer."""
    answer = client.call("list_objects_v2", Bucket=bucket, Prefix=prefix, MaxKeys=1)
    headers = cast("Mapping[str, Mapping[str, str]]", answer["ResponseMetadata"])["HTTPHeaders"]
    return parsedate_to_datetime(headers["date"]).timestamp()


def _second(time: object) -> float:
    return float(int(cast("datetime", time).timestamp()))
