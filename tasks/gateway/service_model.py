"""The files of an SDK's model, service-2.json and paginators-1.json: operations, shapes, errors, pages, help."""

import inspect
import json
import re
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

from annotated_types import Ge, Le, MaxLen, MinLen
from pydantic import StringConstraints
from pydantic.fields import FieldInfo

from specs.base import Spec
from specs.field_types import Timestamp
from specs.robomaker.operations import OPERATIONS, STATUSES, ErrorName, Operation, aliases, document_shapes, location
from tasks.storage.base.local_files import whole_file

Shape = dict[str, Any]
_SCALARS = {str: "string", bool: "boolean", int: "integer", float: "float"}
VERSION = "2018-06-29"
_FOLDER = f"robomaker/{VERSION}"
_TOKEN = "clientRequestToken"  # noqa: S105 - a field's name
_METADATA = {
    "apiVersion": VERSION,
    "endpointPrefix": "robomaker",
    "jsonVersion": "1.1",
    "protocol": "rest-json",
    "protocols": ["rest-json"],
    "serviceAbbreviation": "RoboMaker",  # names the class of clients
    "serviceFullName": "AWS RoboMaker, served by Simyard",
    "serviceId": "RoboMaker",
    "signatureVersion": "v4",
    "signingName": "robomaker",
    "uid": f"robomaker-{VERSION}",
}
_ABOUT = "<p>RoboMaker's API, answered by <code>simyard serve</code>: worlds, simulations and fleets in a store.</p>"
_PAGES = {"input_token": "nextToken", "output_token": "nextToken", "limit_key": "maxResults"}
_ERRORS: Mapping[ErrorName, str] = {
    "InvalidParameter": "A member of the request is missing, unknown or not what it may be; the message names it.",
    "InternalServer": "The service failed, or the store behind it.",
    "Throttling": "The store asks for fewer requests. Try again later.",
    "ResourceNotFound": "There is no resource of that ARN.",
    "ResourceAlreadyExists": "A resource has that name already.",
    "LimitExceeded": "There would be one more than there may be.",
    "IdempotentParameterMismatch": "The token came before, with another request.",
    "ConcurrentDeployment": "The fleet has an active deployment.",
    "ServiceUnavailable": "The store does not answer now. Try again later.",
}
_ATTRIBUTE = re.compile(r"^    (\w+): (.*(?:\n      +.*)*)", re.MULTILINE)


class ShapeTable:
    """The shapes of some documents by name; asking for one adds it with all below it.

    Args:
        structure: Returns the shape of a document class, and may ask for those of its fields.
    """

    def __init__(self, structure: Callable[["ShapeTable", type[Spec]], Shape]) -> None:
        self.shapes: dict[str, Shape] = {}
        self._structure = structure

    def name_of(self, hint: Any, place: str) -> str:  # noqa: ANN401 - a type
        """Returns the name of the shape of a type.

        Args:
            hint: As a field has it; that it may be left out is not part of its shape.
            place: What a shape is called that has no name of its own in specs, such as ``ListFleetsResponseFleets``.
        """
        bare = _present(hint)
        if bare == Timestamp:
            self.shapes["Timestamp"] = {"type": "timestamp"}
            return "Timestamp"
        if isinstance(bare, type) and issubclass(bare, Spec):
            if bare.__name__ not in self.shapes:
                self.shapes[bare.__name__] = {}  # a shape may have itself below it
                self.shapes[bare.__name__] = self._structure(self, bare)
            return bare.__name__
        name = _names().get(_key(bare), place)
        if name not in self.shapes:
            self.shapes[name] = self._shape(_unwrapped(bare), name)
        return name

    def _shape(self, type_: "_Type", name: str) -> Shape:
        if get_origin(type_.kind) is Literal:
            return {"type": "string", "enum": list(get_args(type_.kind))}
        if get_origin(type_.kind) is tuple:
            item = self.name_of(get_args(type_.kind)[0], f"{name}Item")
            return {"type": "list", "member": {"shape": item}, **type_.bounds}
        if get_origin(type_.kind) is dict:
            key, value = get_args(type_.kind)
            sides = {"key": self.name_of(key, f"{name}Key"), "value": self.name_of(value, f"{name}Value")}
            return {"type": "map", **{side: {"shape": each} for side, each in sides.items()}, **type_.bounds}
        return {"type": _SCALARS[type_.kind], **type_.bounds}


class _Type(NamedTuple):
    kind: Any
    bounds: Mapping[str, Any]


def _present(hint: Any) -> Any:  # noqa: ANN401 - a type
    """Returns a type without None."""
    if get_origin(hint) in {Union, UnionType}:
        (hint,) = (each for each in get_args(hint) if each is not type(None))
    return hint


def _unwrapped(hint: Any) -> _Type:  # noqa: ANN401 - a type
    if get_origin(hint) is not Annotated:
        return _Type(hint, {})
    kind, *rules = get_args(hint)
    bounds: Shape = {}
    for rule in rules:
        for each in rule.metadata if isinstance(rule, FieldInfo) else (rule,):
            bounds |= _bounds(each)
    return _Type(kind, bounds)


def _bounds(rule: object) -> Shape:
    match rule:
        case StringConstraints():
            pattern = str(rule.pattern).removeprefix("^(?:").removesuffix(")$")
            return {"min": rule.min_length, "max": rule.max_length, "pattern": pattern}
        case Ge():
            return {"min": rule.ge}
        case Le():
            return {"max": rule.le}
        case MinLen():
            return {"min": rule.min_length}
        case MaxLen():
            return {"max": rule.max_length}
        case _:  # a rule of RoboMaker's prose: no client knew it, and the server says more about it
            return {}


@cache
def _names() -> Mapping[str, str]:
    names: dict[str, str] = {}
    for name, hint in aliases().items():
        names.setdefault(_key(hint), name)
    return names


def _key(hint: Any) -> str:  # noqa: ANN401 - a type
    # Equal types are one shape; what they are made of is not always hashable.
    return repr(hint)


def hints_of(shape: type[Spec]) -> Mapping[str, Any]:
    """Returns the types of a document's fields by name."""
    hints = get_type_hints(shape, include_extras=True)
    return {name: hints[name] for name in shape.model_fields}


def write_model(folder: Path) -> list[Path]:
    """Writes the model below a folder where an SDK looks for models, such as ``~/.aws/models``.

    Returns:
        The files, which are replaced if they were there.

    Raises:
        OSError: The folder cannot be written.
    """
    files = {"service-2.json": service_model(), "paginators-1.json": paginators()}
    for name, content in files.items():
        with whole_file(folder / _FOLDER / name) as file:
            file.write(json.dumps(content, indent=1, ensure_ascii=False).encode() + b"\n")
    return [folder / _FOLDER / name for name in files]


def service_model() -> dict[str, Any]:
    """Returns what service-2.json holds."""
    table = ShapeTable(_structure)
    operations = {each.name: _operation(each, table) for each in OPERATIONS.values()}
    table.shapes["errorMessage"] = {"type": "string"}
    exceptions = {f"{name}Exception": _exception(name) for name in get_args(ErrorName)}
    found = dict(sorted({**table.shapes, **exceptions}.items()))
    return {
        "version": "2.0",
        "metadata": _METADATA,
        "operations": operations,
        "shapes": found,
        "documentation": _ABOUT,
    }


def paginators() -> dict[str, Any]:
    """Returns what paginators-1.json holds."""
    paged = [each for each in OPERATIONS.values() if each.pages]
    return {"pagination": {each.name: {**_PAGES, "result_key": each.pages} for each in paged}}


def _operation(operation: Operation, table: ShapeTable) -> dict[str, Any]:
    asked, answered = document_shapes()[operation.request], document_shapes()[operation.answer]
    members: Shape = table.shapes[table.name_of(asked, operation.request)]["members"]
    table.name_of(answered, operation.answer)
    for name in members:
        where = location(operation, name)
        members[name] |= {} if where == "body" else {"location": where, "locationName": name}
        members[name] |= {"idempotencyToken": True} if operation.idempotent and name == _TOKEN else {}
    return {
        "name": operation.name,
        "http": {"method": operation.method, "requestUri": operation.path},
        "input": {"shape": operation.request},
        "output": {"shape": operation.answer},
        "errors": [{"shape": f"{name}Exception"} for name in operation.errors],
        "documentation": f"{_documentation(asked)}<p>The answer: {_summary(answered)}</p>",
    }


def _structure(table: ShapeTable, shape: type[Spec]) -> Shape:
    told = _attributes(shape)
    members: dict[str, Shape] = {}
    for name, hint in hints_of(shape).items():
        field = shape.model_fields[name]
        extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
        text = field.description or told.get(name, "")
        place = f"{shape.__name__}{name[0].upper()}{name[1:]}"
        members[name] = {"shape": table.name_of(hint, place)}
        members[name] |= {"documentation": f"<p>{_html(text)}</p>"} if text else {}
        members[name] |= {"deprecated": True} if extra.get("deprecated") else {}
    required = [name for name, field in shape.model_fields.items() if field.is_required()]
    listed = {"required": required} if required else {}
    return {"type": "structure", **listed, "members": members, "documentation": _documentation(shape)}


def _exception(name: ErrorName) -> Shape:
    return {
        "type": "structure",
        "members": {"message": {"shape": "errorMessage"}},
        "error": {"httpStatusCode": STATUSES.get(name, 400)},
        "exception": True,
        "documentation": f"<p>{_html(_ERRORS[name])}</p>",
    }


def _documentation(shape: type[Spec]) -> str:
    return f"<p>{_summary(shape)}</p>"


def _summary(shape: type[Spec]) -> str:
    return _html(inspect.getdoc(shape) or "").partition("\n")[0]


def _attributes(shape: type[Spec]) -> dict[str, str]:
    """Returns what the docstrings of a document and of those it extends say about its fields."""
    found: dict[str, str] = {}
    for each in reversed(shape.__mro__):
        _, _, listed = (inspect.cleandoc(each.__doc__ or "")).partition("Attributes:\n")
        found |= {name: " ".join(text.split()) for name, text in _ATTRIBUTE.findall(listed)}
    return found


def _html(text: str) -> str:
    plain = text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return re.sub(r"``(.+?)``", r"<code>\1</code>", plain)
