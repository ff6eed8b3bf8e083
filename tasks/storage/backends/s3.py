"""A store in a bucket of an S3 server that honours conditions on writes.

Every write carries a random mark in the object's metadata. A write whose answer was lost is sent again by the client
and then refused, because its own first copy is there: the mark tells that copy from another writer's
(docs/reference/store.md, section 3).
"""

import hashlib
import tempfile
from collections.abc import Generator, Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime
from email.utils import parsedate_to_datetime
from pathlib import Path
from typing import NoReturn, cast
from uuid import uuid4

from specs.errors import (
    ObjectConflict,
    ObjectExists,
    ObjectNotFound,
    ObjectTooBig,
    SimyardError,
    StoreDamaged,
    StoreError,
    StoreUnreachable,
)
from tasks.storage.backends.s3_access import PART_BYTES, access_to
from tasks.storage.backends.s3_client import Answer, S3Client, is_etag_of, s3_error
from tasks.storage.base.keys import checked_key
from tasks.storage.base.local_files import room_in, whole_file
from tasks.storage.base.store import UNBOUNDED, Entry, StoredObject

_MARK = "simyard-write"
_ATTEMPTS = 5


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


class S3Store:
    """Objects in ``bucket`` below ``prefix``; see ``tasks.storage.base.store.Store`` for what the methods promise."""

    def __init__(self, bucket: str, prefix: str, client: S3Client | None = None) -> None:
        self._bucket = bucket
        self._prefix = f"{prefix}/" if prefix else ""
        self._client = client or S3Client(access_to(bucket))
        self.url = f"s3://{bucket}/{prefix}".rstrip("/")

    def create(self, key: str, body: bytes) -> str:
        """Returns the etag of a new object, or raises ObjectExists."""
        mark = uuid4().hex
        refused: ObjectConflict | None = None
        for _ in range(_ATTEMPTS):
            try:
                return self._place(key, body, mark, {"IfNoneMatch": "*"})
            except ObjectConflict as exc:
                refused = exc
            found, etag = self._mark(key)
            if found == mark:
                return etag
            if found is not None:
                break
            # Refused with nothing there: another's creation is under way or was just removed, and S3 says try again.
        raise ObjectExists(f"{self.url}: {key} exists already") from refused

    def replace(self, key: str, body: bytes, etag: str) -> str:
        """Returns the new etag, or raises ObjectConflict when the object is not the one with ``etag``."""
        mark = uuid4().hex
        try:
            return self._write(key, body, mark, {"IfMatch": etag})
        except (ObjectConflict, ObjectNotFound) as exc:
            found, written = self._mark(key)
            if found == mark:
                return written
            state = "is gone" if found is None else "has changed since it was read"
            raise ObjectConflict(f"{self.url}: {key} {state}") from exc

    def put(self, key: str, body: bytes) -> str:
        """Returns the etag of the object written over whatever was there."""
        return self._place(key, body, uuid4().hex, {})

    def get(self, key: str, most_bytes: int = UNBOUNDED) -> StoredObject:
        """Returns the object, or raises ObjectNotFound, or ObjectTooBig."""
        path = self._path(key)
        with self._explained(key):
            stored = StoredObject(*self._client.read(self._bucket, path, most_bytes + 1))
        if len(stored.body) > most_bytes:
            raise ObjectTooBig(f"{self.url}: {key} has more than {most_bytes} bytes")
        return stored

    def size(self, key: str) -> int:
        """Returns how many bytes the object has, or raises ObjectNotFound."""
        path = self._path(key)
        with self._explained(key):
            return cast("int", self._client.call("head_object", Bucket=self._bucket, Key=path)["ContentLength"])

    def etag(self, key: str) -> str:
        """Returns the object's etag, or raises ObjectNotFound."""
        path = self._path(key)
        with self._explained(key):
            return str(self._client.call("head_object", Bucket=self._bucket, Key=path)["ETag"])

    def blocks(self, key: str, first_byte: int = 0) -> Generator[bytes]:
        """Yields the object's bytes from one of them on, or raises ObjectNotFound."""
        path = self._path(key)
        with self._explained(key):
            yield from self._client.blocks(self._bucket, path, first_byte)

    def exists(self, key: str) -> bool:
        """Returns whether there is an object under the key."""
        return self._mark(key)[0] is not None

    def mark(self, key: str) -> str:
        """Returns the server's ETag and the time of the last change, or raises ObjectNotFound."""
        path = self._path(key)
        with self._explained(key):
            answer: Answer = self._client.call("head_object", Bucket=self._bucket, Key=path)
            metadata = cast("dict[str, str]", answer.get("Metadata") or {})
            return f"{answer['ETag']}-{answer['LastModified']}-{metadata.get(_MARK, '')}"

    def keys(self, prefix: str) -> list[str]:
        """Returns the keys in the folder and below, sorted, without hidden ones."""
        return [entry.key for entry in self.entries(prefix)]

    def entries(self, prefix: str) -> list[Entry]:
        """Returns the keys in the folder and below, sorted, each with its size and age."""
        with self._explained(prefix):
            found = list(list_objects(self._client, self._bucket, self._prefix, self._folder(prefix)))
        return sorted((entry for entry in found if _is_shown(entry.key)), key=lambda entry: entry.key)

    def entry(self, key: str) -> Entry:
        """Returns one object with its size and age, or raises ObjectNotFound."""
        path = self._path(key)
        with self._explained(key):
            return entry_of(key, self._client.call("head_object", Bucket=self._bucket, Key=path), "ContentLength")

    def now_s(self) -> float:
        """Returns the time by the server's clock, as its answers tell it."""
        with self._explained(""):
            return server_now_s(self._client, self._bucket, self._prefix)

    def delete_unchanged(self, entry: Entry) -> bool:
        """Removes the object unless it was written since; see Store for what a server can tell."""
        path = self._path(entry.key)
        try:
            with self._explained(entry.key):
                answer: Answer = self._client.call("head_object", Bucket=self._bucket, Key=path)
                if object_mark(answer) != entry.mark:
                    return False
                # Servers that do not know the condition ignore it, or refuse what is gone in their own way.
                self._client.call("delete_object", Bucket=self._bucket, Key=path, IfMatch=answer["ETag"])
        except ObjectNotFound:
            return True
        except ObjectConflict:
            return False
        return True

    def unfinished(self, prefix: str) -> list[Entry]:
        """Returns the uploads in parts to the folder and below that have not come to their end."""
        with self._explained(prefix):
            return list_uploads(self._client, self._bucket, self._prefix, self._folder(prefix))

    def discard(self, write: Entry) -> None:
        """Tells the server to forget the parts of an upload."""
        self._abort(write.key, write.mark)

    def delete(self, key: str) -> None:
        """Removes the object if it is there."""
        path = self._path(key)
        try:
            with self._explained(key):
                self._client.call("delete_object", Bucket=self._bucket, Key=path)
        except ObjectNotFound:  # some servers say so, S3 does not
            return

    def upload(self, key: str, source: Path) -> None:
        """Sends the file; readers see the old object or the whole new one, and a damaged one is removed."""
        path = self._path(key)
        source.open("rb").close()  # a missing file is the caller's fault, not the store's
        with self._explained(key):
            self._client.send(source, self._bucket, path)
            etag = str(self._client.call("head_object", Bucket=self._bucket, Key=path)["ETag"])
        if not is_etag_of(etag, source, PART_BYTES) and not self._holds(key, source):
            self._remove_damaged(key)

    def sweep(self, key: str) -> None:
        """Tells the server to forget the parts of uploads that never came to their end."""
        path = self._path(key)
        with self._explained(key):
            answer = self._client.call("list_multipart_uploads", Bucket=self._bucket, Prefix=path)
            for upload in cast("list[dict[str, str]]", answer.get("Uploads", [])):
                if upload["Key"] == path:
                    self._abort(key, upload["UploadId"])

    def download(self, key: str, target: Path) -> None:
        """Writes the object to the file, which appears whole or not at all."""
        path = self._path(key)
        with room_in(target.parent), whole_file(target) as file, self._explained(key):
            for block in self._client.blocks(self._bucket, path, 0):
                with room_in(target.parent):  # or this machine's full disk would pass for the bucket's
                    file.write(block)

    def _holds(self, key: str, source: Path) -> bool:
        """Returns whether the object has the bytes of the file, from reading it: encryption makes other etags."""
        with tempfile.TemporaryDirectory(prefix="simyard-verify-") as folder:
            copy = Path(folder) / "copy"
            self.download(key, copy)
            with copy.open("rb") as ours, source.open("rb") as theirs:
                return hashlib.file_digest(ours, "sha256").digest() == hashlib.file_digest(theirs, "sha256").digest()

    def _abort(self, key: str, upload: str) -> None:
        path = self._path(key)
        try:
            with self._explained(key):
                self._client.call("abort_multipart_upload", Bucket=self._bucket, Key=path, UploadId=upload)
        except ObjectNotFound:  # another has ended it, or some servers list what is over
            return

    def _remove_damaged(self, key: str) -> NoReturn:
        damage = f"{self.url}: {key}: what arrived is not what was sent"
        try:
            self.delete(key)
        except StoreError as exc:
            raise StoreDamaged(f"{damage}, and it could not be removed") from exc
        raise StoreDamaged(damage)

    def _folder(self, prefix: str) -> str:
        return f"{self._path(prefix.rstrip('/'))}/" if prefix else self._prefix

    def _path(self, key: str) -> str:
        return self._prefix + checked_key(key)

    def _place(self, key: str, body: bytes, mark: str, condition: dict[str, str]) -> str:
        try:
            return self._write(key, body, mark, condition)
        except ObjectNotFound as exc:  # what is to be made cannot be missing: the place for it is
            raise StoreUnreachable(f"{self.url}: {key}: the server knows no such bucket; is it an S3 server?") from exc

    def _write(self, key: str, body: bytes, mark: str, condition: dict[str, str]) -> str:
        path = self._path(key)
        with self._explained(key):
            return self._client.put(self._bucket, path, body, Metadata={_MARK: mark}, **condition)

    def _mark(self, key: str) -> tuple[str | None, str]:
        # The mark of the last write ("" for an object that was not written here, None for no object), and its etag.
        path = self._path(key)
        try:
            with self._explained(key):
                answer: Answer = self._client.call("head_object", Bucket=self._bucket, Key=path)
                return cast("dict[str, str]", answer["Metadata"]).get(_MARK, ""), str(answer["ETag"])
        except ObjectNotFound:
            return None, ""

    @contextmanager
    def _explained(self, key: str) -> Generator[None]:
        try:
            yield
        except SimyardError:  # explained already
            raise
        except Exception as exc:  # who answers may be anybody: whatever came of it, the store was not reached
            raise s3_error(exc, self.url, key) from exc


def _is_shown(key: str) -> bool:
    return not any(part.startswith(".") or not part for part in key.split("/"))
