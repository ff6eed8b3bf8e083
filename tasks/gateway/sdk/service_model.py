"""The files of an SDK's model, service-2.json and paginators-1.json: operations, shapes, errors, pages, help."""

import inspect
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

from specs.base import Spec
from specs.interface.operations import OPERATIONS, STATUSES, ErrorName, Operation, location
from specs.interface.shapes import shapes
from tasks.gateway.sdk.type_shapes import Shape, ShapeTable, hints_of
from tasks.storage.base.atomic_file import whole_file

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
    asked, answered = shapes()[operation.request], shapes()[operation.answer]
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
