"""One canonical form for documents, so that equal documents have equal digests wherever and whenever they are made."""

import hashlib
import json
from collections.abc import Mapping

from pydantic import BaseModel, JsonValue


def canonical_document(model: BaseModel) -> dict[str, JsonValue]:
    """Returns a document as plain JSON data: defaults spelled out, absent fields left out."""
    return model.model_dump(mode="json", exclude_none=True)


def without_absent(value: JsonValue) -> JsonValue:
    """Returns JSON data as `canonical_document` has it: fields that are null left out, however deep."""
    if isinstance(value, dict):
        return {name: without_absent(each) for name, each in value.items() if each is not None}
    return [without_absent(each) for each in value] if isinstance(value, list) else value


def canonical_json(document: Mapping[str, JsonValue]) -> bytes:
    """Returns JSON bytes with sorted keys and no spaces (UTF-8).

    Raises:
        ValueError: For NaN or infinity, which JSON has no words for.
    """
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return text.encode()


def digest(model: BaseModel) -> str:
    """Returns the SHA-256 of a document's canonical JSON, lower-case hex."""
    return hashlib.sha256(canonical_json(canonical_document(model))).hexdigest()
