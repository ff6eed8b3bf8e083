"""Finds a template where a document says it is: in the document, a file, a bucket, or the store."""

from pathlib import Path

from pydantic import JsonValue

from specs.arn import parse_reference
from specs.errors import (
    BucketNotFound,
    DocumentError,
    ObjectNotFound,
    ObjectTooBig,
    ResourceNotFound,
    StoreAccessDenied,
)
from specs.template.body import TemplateBody, looks_like_body
from tasks.documents.parse import parse
from tasks.documents.source_text import decode_source_text, read_document
from tasks.storage.base.keys import NAMED_TEMPLATE_PREFIX, named_template_key, template_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.templates import NamedTemplate, find_template_name, read_template

_BODY_BYTES = 1 << 20
"""The 262,144 characters of a body's text have at most four bytes each."""


def find_template(template: str | TemplateBody, store: Store, base: Path) -> TemplateBody:
    """Returns the body of the template that a document's ``worldGeneration.template`` means.

    A path wins over a name that is in the store: what lies beside the document is what its author sees.

    Args:
        template: A body, a path, ``s3://bucket/key``, an ARN, or the name of a template in the store.
        store: Where names, ARNs and buckets lead.
        base: Folder that relative paths start from.

    Raises:
        ResourceNotFound: There is no such template.
        DocumentError: There is one, and it is not a template body.
    """
    if isinstance(template, TemplateBody):
        return template
    if template.startswith("s3://"):
        bucket, _, key = template.removeprefix("s3://").partition("/")
        return _parse_template(_read_stored(open_bucket(store, bucket), key, template), template)
    path = base / template
    if not template.startswith("arn:") and path.is_file():
        return _body(read_document(path), str(path))
    name = parse_reference(template).path
    if named := _named(template, name, store):
        return _parse_template(_read_stored(store, template_key(named.digest), template), template)
    if any(mark in name for mark in "/. "):
        raise _missing(template, f"a file ({path} is none), s3://bucket/key, or a template in {store.url}")
    return _parse_template(_read_stored(store, template_key(name), template), template)


def find_template_in_bucket(bucket: str, key: str, store: Store) -> TemplateBody:
    """Returns the body that lies in a bucket, where a request of RoboMaker's says it does.

    Args:
        bucket: Name of the bucket.
        key: Of the object in it.
        store: Where buckets are found.

    Raises:
        ResourceNotFound: There is no such bucket or object.
        DocumentError: Nobody may read it, or it is no template body.
    """
    source = f"s3://{bucket}/{key}"
    try:
        body = open_bucket(store, bucket).get(key, _BODY_BYTES).body
    except (ObjectNotFound, BucketNotFound) as exc:
        raise ResourceNotFound.of("templateLocation", source, "a template; none is there") from exc
    except (ObjectTooBig, StoreAccessDenied) as exc:
        raise DocumentError.of("templateLocation", source, f"a template: {exc}") from exc
    return _parse_template(body, source)


def _named(template: str, name: str, store: Store) -> NamedTemplate | None:
    """Returns the template that somebody made by a call and that an ARN, an id or a name means; None for any other."""
    if name.startswith(NAMED_TEMPLATE_PREFIX) and store.exists(named_template_key(name)):
        return read_template(store, name)
    return None if template.startswith("arn:") else find_template_name(store, name)


def _read_stored(store: Store, key: str, template: str) -> bytes:
    try:
        return store.get(key).body
    except ObjectNotFound as exc:
        raise _missing(template, f"a template; {store.url} has none there") from exc


def _parse_template(body: bytes, source: str) -> TemplateBody:
    return _body(decode_source_text(body, source), source)


def _body(data: JsonValue, source: str) -> TemplateBody:
    """Returns a body; of data that has nothing of one, no word is repeated.

    Whoever writes a document may name any file that who runs it can read: what is in that is not for the log of a run.

    Raises:
        DocumentError: It is no template body.
    """
    if not looks_like_body(data):
        allowed = (
            "a template body, which has Buildings; what is in the file is not shown, because it has nothing of one"
        )
        raise DocumentError.of("file", "something else", allowed, source=source)
    return parse(TemplateBody, data, source)


def _missing(template: str, allowed: str) -> DocumentError:
    return ResourceNotFound.of("worldGeneration.template", repr(template), allowed)
