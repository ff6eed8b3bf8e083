"""XML-RPC as text: calls and answers; no document type, so that no entity is ever expanded."""

import datetime
import xmlrpc.client
from typing import Any, NoReturn, TypeAlias, cast
from xml.parsers import expat

from tasks.ros.graph.wire import graph_limits as limits

Value: TypeAlias = "bool | int | float | str | bytes | datetime.datetime | list[Value] | dict[str, Value] | None"
_OVERHEAD_BYTES = 64


class XmlRpcError(ValueError):
    """The bytes are not a call or an answer."""


def read(data: bytes) -> tuple[tuple[Value, ...], str | None]:
    """Returns the arguments and the method of a call; of an answer, its value alone and None.

    Raises:
        XmlRpcError: If it is no XML-RPC, or brings a document type.
        xmlrpc.client.Fault: If it is an answer that says so.
    """
    target = xmlrpc.client.Unmarshaller(use_builtin_types=True)
    # Texts come from expat as str: there is no encoding left to undo.
    target.xml(cast("str", None), None)
    parser = expat.ParserCreate(None, None)
    parser.StartElementHandler = target.start
    parser.EndElementHandler = target.end
    parser.CharacterDataHandler = target.data
    parser.StartDoctypeDeclHandler = _refuse_document_type
    try:
        parser.Parse(data, True)  # noqa: FBT003 - expat takes no keyword
        values = cast("tuple[Value, ...]", tuple(cast("Any", target.close())))
    except xmlrpc.client.Fault:
        raise
    except (expat.ExpatError, xmlrpc.client.Error, ValueError, TypeError, LookupError, AttributeError) as exc:
        raise XmlRpcError(f"no XML-RPC: {exc}") from exc
    _check_depth(values)
    return values, target.getmethodname()


def write_call(method: str, arguments: tuple[Value, ...]) -> bytes:
    """Returns a call."""
    return xmlrpc.client.dumps(cast("Any", arguments), method).encode()


def write_answer(value: Value) -> bytes:
    """Returns an answer; a fault if the value has no form in XML-RPC."""
    try:
        return xmlrpc.client.dumps(cast("Any", (value,)), methodresponse=True).encode()
    except (TypeError, OverflowError, UnicodeEncodeError, ValueError) as exc:
        return write_fault(f"the answer has no form in XML-RPC: {exc}")


def write_fault(reason: str) -> bytes:
    """Returns an answer that says what is wrong with the call."""
    return xmlrpc.client.dumps(xmlrpc.client.Fault(1, reason.encode("ascii", "replace").decode())).encode()


def weight(value: Value, depth: int = 0) -> int:
    """Returns about how many bytes a value takes.

    Raises:
        XmlRpcError: If it holds what no node can be given: nothing, numbers of more than 32 bits, too many levels.
    """
    if depth > limits.PARAMETER_DEPTH:
        raise XmlRpcError(f"a value of more than {limits.PARAMETER_DEPTH} levels")
    if isinstance(value, dict):
        return sum(weight(key) + weight(each, depth + 1) for key, each in value.items()) + _OVERHEAD_BYTES
    if isinstance(value, list):
        return sum(weight(each, depth + 1) for each in value) + _OVERHEAD_BYTES
    if isinstance(value, str | bytes):
        return len(value) + _OVERHEAD_BYTES
    if isinstance(value, int) and not -(2**31) <= value < 2**31:
        raise XmlRpcError(f"{value}: XML-RPC has whole numbers of 32 bits")
    if isinstance(value, int | float | datetime.datetime):
        return _OVERHEAD_BYTES
    raise XmlRpcError(f"{type(value).__name__}: a parameter is a bool, number, text, time, list or mapping")


def _check_depth(values: tuple[Value, ...]) -> None:
    """Refuses what a function that calls itself could not go through."""
    level: list[Value] = [each for each in values if isinstance(each, list | dict)]
    # Arguments of a multicall lie within three levels of its own.
    for _ in range(limits.PARAMETER_DEPTH + 4):
        below = [each.values() if isinstance(each, dict) else each for each in level if isinstance(each, list | dict)]
        level = [each for values in below for each in values if isinstance(each, list | dict)]
        if not level:
            return
    raise XmlRpcError(f"a value of more than {limits.PARAMETER_DEPTH} levels")


def _refuse_document_type(*_: object) -> NoReturn:
    raise XmlRpcError("a document type: calls have none")
