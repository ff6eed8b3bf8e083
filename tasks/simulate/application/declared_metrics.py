"""Which metrics a scenario measures, read from its bundle's sources, so that checking a document runs no strange code.

Only what the sources say plainly counts: functions named ``metrics`` that return dictionaries with written-out keys.
Where a name is computed, or may come from elsewhere, nothing is known, and nothing is refused.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

_METRICS = "metrics"
# What a scenario may be made of that brings no metrics along.
_PLAIN_BASES = frozenset({"NamedTuple", "Protocol", "Generic", "object", "Enum", "IntEnum", "ABC"})
_MOST_FILES = 1_000
_Function = ast.FunctionDef | ast.AsyncFunctionDef


class _NotPlainError(Exception):
    """The sources do not say plainly which metrics there are."""


def declared_metrics(bundle: Path) -> frozenset[str] | None:
    """Returns the names that the scenarios of a bundle measure; None where its sources do not say them plainly.

    Args:
        bundle: Its unpacked folder.
    """
    try:
        modules = [ast.parse(path.read_bytes()) for path in sorted(bundle.rglob("*.py"))[:_MOST_FILES]]
        return frozenset(name for module in modules for name in _names(module, _classes(modules)))
    except (_NotPlainError, OSError, SyntaxError, ValueError, RecursionError):
        return None


def _classes(modules: list[ast.Module]) -> frozenset[str]:
    return frozenset(node.name for module in modules for node in ast.walk(module) if isinstance(node, ast.ClassDef))


def _names(module: ast.Module, own: frozenset[str]) -> Iterator[str]:
    for node in ast.walk(module):
        if isinstance(node, _Function) and node.name == _METRICS:
            yield from _returned(node)
        elif _binds_metrics(node) or (isinstance(node, ast.ClassDef) and not _is_plain(node, own)):
            raise _NotPlainError


def _is_plain(node: ast.ClassDef, own: frozenset[str]) -> bool:
    """Returns whether a class has its methods from this bundle alone."""
    bases = [base.value if isinstance(base, ast.Subscript) else base for base in node.bases]
    names = [base.id if isinstance(base, ast.Name) else getattr(base, "attr", "") for base in bases]
    answers = any(isinstance(each, _Function) and each.name.startswith("__getattr") for each in node.body)
    return not answers and not node.keywords and set(names) <= own | _PLAIN_BASES


def _binds_metrics(node: ast.AST) -> bool:
    """Returns whether a statement gives something that name in another way than by a function's definition."""
    if isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
        return _METRICS in {getattr(node, "id", ""), getattr(node, "attr", "")}
    if isinstance(node, ast.alias):
        return _METRICS in {node.asname, node.name.rpartition(".")[2]} or node.name == "*"
    if isinstance(node, ast.keyword):  # SimpleNamespace(metrics=...)
        return node.arg == _METRICS
    # setattr(..., "metrics", ...) and the like
    return isinstance(node, ast.Constant) and node.value == _METRICS


def _returned(function: _Function) -> Iterator[str]:
    """Yields the keys of what a function returns."""
    kept = dict(_written(function))
    answers = [node.value for node in _body(function) if isinstance(node, ast.Return)]
    for answer in answers:
        if isinstance(answer, ast.Name) and answer.id in kept:
            yield from kept[answer.id]
        else:
            yield from _keys(answer)


def _written(function: _Function) -> Iterator[tuple[str, list[str]]]:
    """Yields the variables of a function that are nothing but one dictionary, with all keys that it gets."""
    found: dict[str, list[str]] = {}
    for node in _body(function):
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Dict) and len(node.targets) == 1:
            target = node.targets[0]
            if isinstance(target, ast.Name) and target.id not in found:
                found[target.id] = _keys(node.value)
    for name, keys in found.items():
        uses = [node for node in _body(function) if isinstance(node, ast.Name) and node.id == name]
        added = [_added_key(node, name) for node in _body(function)]
        plain = [key for key in added if key is not None]
        returns = sum(isinstance(node, ast.Return) and _is_name(node.value, name) for node in _body(function))
        if len(uses) == 1 + len(plain) + returns:  # its making, its keys and its return are all that is done with it
            yield name, [*keys, *plain]


def _added_key(node: ast.AST, name: str) -> str | None:
    if isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store) and _is_name(node.value, name):
        key = node.slice
        return key.value if isinstance(key, ast.Constant) and isinstance(key.value, str) else None
    return None


def _is_name(node: ast.AST | None, name: str) -> bool:
    return isinstance(node, ast.Name) and node.id == name


def _keys(answer: ast.expr | None) -> list[str]:
    """Returns the written-out keys of a dictionary."""
    if isinstance(answer, ast.Dict):
        names = [key.value for key in answer.keys if isinstance(key, ast.Constant) and isinstance(key.value, str)]
        if len(names) == len(answer.keys):
            return names
    if isinstance(answer, ast.Call) and _is_name(answer.func, "dict") and not answer.args:
        names = [each.arg for each in answer.keywords if each.arg is not None]
        if len(names) == len(answer.keywords):
            return names
    raise _NotPlainError


def _body(function: _Function) -> Iterator[ast.AST]:
    """Yields what is inside a function, and not in functions inside it."""
    waiting: list[ast.AST] = [*function.body]
    while waiting:
        node = waiting.pop()
        yield node
        if not isinstance(node, _Function | ast.Lambda | ast.ClassDef):
            waiting += ast.iter_child_nodes(node)
