"""The parameters of a flow: a store without a password in it, and a document, a section of one, or its file.

A parameter is kept in Prefect's database, shown in its pages and written to logs. Prefect makes the run, with its
parameters, before it looks at them, and logs what it refuses (docs/reference/prefect.md, section 4). So what would
carry a secret is refused before Prefect has it: by the JSON schema that the server checks, and by the same rule here.

A store is a URL or a block of Prefect's: prefect-aws's S3 Bucket, or its AWS Credentials and a place. The block is read
when a run begins, and its credentials stay in this process. prefect-aws itself is not needed here.

A document's file is read when a run begins, and its content decides which run that is, as for `simyard run`: a
deployment that names one runs what stands there tonight. Prefect keeps the file's name.
"""

import inspect
import os
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple, ParamSpec, TypeVar, cast, get_args, get_type_hints

from prefect import Flow
from prefect.client.orchestration import get_client
from prefect.exceptions import ObjectNotFound
from pydantic import BeforeValidator, Field, GetJsonSchemaHandler, WithJsonSchema
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from specs.base import Spec
from specs.errors import DocumentError
from specs.field_types import Path as SourcePath
from specs.pipeline.document import PipelineSpec
from specs.pipeline.simulation_section import Deployment, SimulationBatch
from specs.pipeline.world_sections import WorldExport, WorldGeneration
from specs.rules import broken
from tasks.documents.parse import parse
from tasks.documents.pipeline_file import is_meant_as_document, pipeline_of
from tasks.documents.source_text import read_document
from tasks.storage.backends.s3_access import S3Access, give_access

ALLOWED = (
    "file:///folder, s3://bucket/prefix, block://s3-bucket/NAME or block://aws-credentials/NAME/bucket/prefix, without "
    "a password, key or token in it: credentials come from the environment, or from the block"
)
# A password before the host, also one with a slash in it, as AWS makes them, or something like key=... after a question
# mark. Without (?i), which JavaScript lacks.
_CARRIES = (
    r"//[^/]*@|^[^/]*//[^/]*:|[?&#;][^=]*([Kk][Ee][Yy]|[Ss][Ee][Cc][Rr][Ee][Tt]|[Tt][Oo][Kk][Ee][Nn]|[Pp][Aa][Ss][Ss]"
    r"|[Ss][Ii][Gg]|[Cc][Rr][Ee][Dd])[^=]*="
)


def has_secret(url: str) -> bool:
    """Returns whether a URL carries a password, a key or a token."""
    return re.search(_CARRIES, url) is not None


def without_secret(value: object) -> object:
    """Returns a store's name as it is.

    Raises:
        PydanticCustomError: It carries a secret; the message does not.
    """
    if isinstance(value, str) and has_secret(value):
        raise broken(ALLOWED)
    return value


StoreParameter = Annotated[
    str | None,
    BeforeValidator(without_secret),
    # With "not", the server's message would repeat the value; that of "const" says only what is allowed.
    WithJsonSchema(
        {
            "anyOf": [{"type": "string"}, {"type": "null"}],
            "if": {"type": "string", "pattern": _CARRIES},
            "then": {"const": ALLOWED},
        }
    ),
]
"""A store, as a parameter of a flow; None is SIMYARD_STORE, else ``.simyard`` in the working directory."""


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
    return DocumentError.of("store", repr(chosen), allowed, source="parameters")


_SPEC, _BASE, _FILE = "spec", "base", "document"
# Not by "required": Prefect's server leaves that out where it checks the parameters of a deployment, to which a run may
# add others.
_NAMES_A_FILE = {"not": {"properties": {_FILE: {"not": {}}}}}


class DocumentFile(Spec):
    """A document in a file, of the machine that runs it."""

    document: SourcePath = Field(title="File", description="Its path, from the base or the worker's working directory.")


class _OrFile:
    """Says that a parameter may name a document's file, and what it takes of the document.

    Args:
        section: The section; empty for the whole document.
    """

    def __init__(self, section: str = "") -> None:
        self.section = section

    def __get_pydantic_json_schema__(self, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Returns the schema with both: the form has one field more, and the server tells what is wrong with which."""
        given, file = handler(core_schema), DocumentFile.model_json_schema()
        fields = {**file["properties"], **handler.resolve_ref_schema(given)["properties"]}
        shown = {name: {**below, "position": position} for position, (name, below) in enumerate(fields.items())}
        return {"type": "object", "properties": shown, "if": _NAMES_A_FILE, "then": file, "else": given}


DocumentParameter = Annotated[PipelineSpec, _OrFile()]
"""A document, or ``{document: path}``."""
WorldGenerationParameter = Annotated[WorldGeneration, _OrFile("worldGeneration")]
"""A document's section ``worldGeneration``, or ``{document: path}``; those below likewise."""
WorldExportParameter = Annotated[WorldExport, _OrFile("worldExport")]
SimulationBatchParameter = Annotated[SimulationBatch, _OrFile("simulationBatch")]
DeploymentParameter = Annotated[Deployment, _OrFile("deployment")]


def with_document(function: Callable[..., object], parameters: dict[str, Any]) -> dict[str, Any]:
    """Returns a flow's parameters with what stands in the file that they name, if they name one.

    The base becomes the file's folder, from which the paths in a document start.

    Args:
        function: The flow's.
        parameters: As they were given.

    Raises:
        DocumentError: There is no such file, or what it holds is wrong; with all its faults.
    """
    hint = get_type_hints(function, include_extras=True).get(_SPEC)
    given, form = parameters.get(_SPEC), next((each for each in get_args(hint)[1:] if isinstance(each, _OrFile)), None)
    if form is None or not isinstance(given, Mapping) or _FILE not in given:
        return parameters
    named = parse(DocumentFile, cast("Any", dict(cast("Mapping[str, object]", given))), _SPEC).document
    path = Path(parameters.get(_BASE) or ".") / named
    if not path.is_file():
        allowed = f"a document on this machine; {path.resolve()} is no file"
        raise DocumentError.of(f"{_SPEC}.{_FILE}", repr(named), allowed, source="parameters")
    found = _part(_document_in(path), form.section, path)
    base = {_BASE: str(path.parent)} if _BASE in inspect.signature(function).parameters else {}
    return {**parameters, **base, _SPEC: found}


def _document_in(path: Path) -> PipelineSpec:
    """Returns the document in a file.

    Faults are kept with the run, where who may not read the worker's files sees them: so nothing of what a file of
    another kind holds, such as a password, is told.

    Raises:
        DocumentError: It holds none, or one with faults.
    """
    data = read_document(path)
    if not is_meant_as_document(data):
        sections = ", ".join(name for name in PipelineSpec.model_fields if name != "name")
        raise DocumentError.of(
            _FILE, "no document of Simyard's", f"a file with some of {sections} at its top", source=str(path)
        )
    return pipeline_of(data, path, path.parent)


def _part(spec: PipelineSpec, section: str, path: Path) -> object:
    found = getattr(spec, section) if section else spec
    if found is None:
        raise DocumentError.of(section, "missing", "a section, which this flow runs", source=str(path))
    return found


P = ParamSpec("P")
R = TypeVar("R")
_STORE = "store"


class GuardedFlow(Flow[P, R]):
    """A flow that refuses a store with a password in it, and reads its document from a file, however it is called."""

    def serialize_parameters(self, parameters: dict[str, Any]) -> dict[str, Any]:
        """Returns the parameters as JSON for a run that is about to be made.

        Raises:
            DocumentError: The store carries a secret.
        """
        _require_no_secret(parameters)
        return super().serialize_parameters(parameters)

    def validate_parameters(self, parameters: dict[str, Any]) -> dict[str, Any]:
        """Returns the parameters as the flow's types; Prefect would log those that are none, with the secret.

        Raises:
            DocumentError: The store carries a secret, or the file that is to be the document is none.
        """
        _require_no_secret(parameters)
        return super().validate_parameters(with_document(self.fn, parameters))

    def with_options(self, **options: Any) -> "GuardedFlow[P, R]":  # noqa: ANN401 - Prefect's, handed on
        """Returns a flow with other options, which refuses the same."""
        changed = super().with_options(**options)
        changed.__class__ = type(self)
        return cast("GuardedFlow[P, R]", changed)


def guarded(flow: Flow[P, R]) -> Flow[P, R]:
    """Returns the flow, made to refuse a store with a password in it."""
    flow.__class__ = GuardedFlow
    return flow


def _require_no_secret(parameters: Mapping[str, object]) -> None:
    store = parameters.get(_STORE)
    if isinstance(store, str) and has_secret(store):
        raise DocumentError.of(_STORE, "a URL with a secret in it", ALLOWED, source="parameters")
