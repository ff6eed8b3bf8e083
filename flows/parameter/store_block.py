"""Stores that a block of Prefect's names: prefect-aws's S3 Bucket, or its AWS Credentials and a place.

The block is read when a run begins, and its credentials stay in this process. Only the reference is a parameter of the
run. prefect-aws itself is not needed here: a block is a document on Prefect's server.
"""

import os
from collections.abc import Mapping
from typing import Any, NamedTuple, cast

from prefect.client.orchestration import get_client
from prefect.exceptions import ObjectNotFound

from specs.base import Fault
from specs.errors import DocumentError
from tasks.storage.backends.s3_access import S3Access, give_access

_SCHEME = "block://"
_BUCKET = "s3-bucket"
_CREDENTIALS = ("aws-credentials", "minio-credentials")
_FORMS = f"{_SCHEME}{_BUCKET}/NAME, or {_SCHEME}{_CREDENTIALS[0]}/NAME/bucket/prefix"
Block = Mapping[str, Any]


class _Reference(NamedTuple):
    kind: str
    name: str
    place: str


def store_at(reference: str | None) -> str | None:
    """Returns the URL of the store that a flow's parameter names, which this process can open from then on.

    Args:
        reference: A URL, a block, or None for SIMYARD_STORE, which may name a block, too.

    Raises:
        DocumentError: There is no such block, or it says what Simyard does not know.
    """
    chosen = reference or os.environ.get("SIMYARD_STORE") or ""
    if not chosen.startswith(_SCHEME):
        return reference
    named = _reference(chosen)
    found = _block(named, chosen)
    bucket, _, prefix = named.place.partition("/")
    credentials = found
    if named.kind == _BUCKET:
        bucket, prefix = str(found["bucket_name"]), str(found.get("bucket_folder") or "")
        credentials = cast("Block", found.get("credentials") or {})
    give_access(bucket, _access(credentials, chosen))
    return f"s3://{bucket}/{prefix.strip('/')}".rstrip("/")


def _reference(chosen: str) -> _Reference:
    kind, _, rest = chosen.removeprefix(_SCHEME).partition("/")
    name, _, place = rest.partition("/")
    if not name or (place if kind == _BUCKET else not place) or kind not in (_BUCKET, *_CREDENTIALS):
        raise _refused(chosen, _FORMS)
    return _Reference(kind, name, place)


def _block(named: _Reference, chosen: str) -> Block:
    with get_client(sync_client=True) as client:
        try:
            return cast("Block", client.read_block_document_by_name(named.name, named.kind).data)
        except ObjectNotFound as exc:
            raise _refused(chosen, "a block that Prefect's server has: prefect block ls") from exc


def _access(credentials: Block, chosen: str) -> S3Access:
    unknown = [name for name in ("profile_name", "assume_role_arn") if credentials.get(name)]
    if unknown:
        raise _refused(chosen, f"a block without {unknown[0]}: set it in the worker's environment or AWS profile")
    client = cast("Block", credentials.get("aws_client_parameters") or {})
    ignored = [name for name, value in client.items() if name != "endpoint_url" and value not in (None, True, {}, "")]
    if ignored:
        raise _refused(chosen, f"a block whose client parameters say nothing but endpoint_url, not {ignored[0]}")
    return S3Access(
        key_id=_text(credentials, "aws_access_key_id", "minio_root_user"),
        secret=_text(credentials, "aws_secret_access_key", "minio_root_password"),
        token=_text(credentials, "aws_session_token"),
        region=_text(credentials, "region_name"),
        endpoint=_text(client, "endpoint_url"),
    )


def _text(block: Block, *names: str) -> str:
    return next((str(block[name]) for name in names if block.get(name)), "")


def _refused(chosen: str, allowed: str) -> DocumentError:
    return DocumentError([Fault(path="store", value=repr(chosen), allowed=allowed)], "parameters")
