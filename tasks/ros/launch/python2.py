"""What a node's program has of Python 2, with file and line: Noetic runs Python 3, RoboMaker's users had Kinetic.

Only what is certain to fail is told: syntax that Python 3 does not have, modules and names that are gone. What stands
in a ``try``, or in an ``if`` that asks for a version, may be for both.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

_MOST_BYTES = 4 << 20
_MODULES = frozenset({"Queue", "ConfigParser", "StringIO", "cPickle", "Tkinter", "httplib", "urllib2", "urlparse"})
_IMPORTED = frozenset({("itertools", name) for name in ("izip", "imap", "ifilter", "izip_longest")})
_NAMES = frozenset({"xrange", "raw_input", "unicode", "basestring", "unichr", "reduce", "execfile"})
_MOST = 5


def python2_sentences(program: Path, shown: str) -> list[str]:
    """Returns what of a program Python 3 does not run, one sentence each, a few at most; none for other programs.

    Args:
        program: The file that a node runs.
        shown: What a person calls it.
    """
    text = _python(program)
    try:
        tree = ast.parse(text)
    except SyntaxError as exc:
        found = [(exc.lineno, f"no Python 3: {exc.msg}")] if exc.lineno else []  # bytes that are no text have no line
    except (ValueError, RecursionError, MemoryError):
        return []  # what it says when it runs is in its output
    else:
        found = sorted(set(_gone(tree)))
    return [f"{shown}, line {line}: {what}: 2to3 -w rewrites Python 2" for line, what in found[:_MOST]]


def python_tree(program: Path) -> ast.Module | None:
    """Returns a program in Python 3 as a tree; None for another one."""
    text = _python(program)
    try:
        return ast.parse(text) if text else None
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return None  # what it says when it runs is in its output


def imported_modules(program: Path) -> list[tuple[int, str]]:
    """Returns line and name of modules that a program in Python 3 imports; what it only tries to is none."""
    tree = python_tree(program) or ast.Module([], [])
    tried = {id(inner) for each in ast.walk(tree) if _for_both(each) for inner in ast.walk(each)}
    found = [each for each in ast.walk(tree) if isinstance(each, _IMPORTS) and id(each) not in tried]
    modules = ((each.lineno, name) for each in found for name in _modules(each))
    return sorted((line, name.partition(".")[0]) for line, name in modules)


def _modules(imports: ast.Import | ast.ImportFrom) -> Iterator[str]:
    if isinstance(imports, ast.Import):
        yield from (each.name for each in imports.names)
    elif imports.module and not imports.level:
        yield imports.module


def _python(program: Path) -> bytes:
    """Returns the text of a program or a module in Python; nothing of another one."""
    try:
        with program.open("rb") as file:
            text = file.read(_MOST_BYTES)
    except OSError:
        return b""
    first = text.partition(b"\n")[0]
    return text if (b"python" in first if first.startswith(b"#!") else program.suffix == ".py") else b""


def _gone(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Yields line and words of modules and names that Python 3 does not have."""
    tried = {id(inner) for each in ast.walk(tree) if _for_both(each) for inner in ast.walk(each)}
    own = {each.id for each in ast.walk(tree) if isinstance(each, ast.Name) and not isinstance(each.ctx, ast.Load)}
    own |= {name.asname or name.name for each in ast.walk(tree) if isinstance(each, _IMPORTS) for name in each.names}
    own |= {each.name for each in ast.walk(tree) if isinstance(each, _DEFINITIONS)}
    own |= {each.arg for each in ast.walk(tree) if isinstance(each, ast.arg)}
    for each in ast.walk(tree):
        if id(each) in tried:
            continue
        if isinstance(each, ast.Import):
            yield from ((each.lineno, f"Python 3 has no module {n.name}") for n in each.names if n.name in _MODULES)
        elif isinstance(each, ast.ImportFrom) and not each.level:
            if each.module in _MODULES:
                yield each.lineno, f"Python 3 has no module {each.module}"
            names = (name.name for name in each.names if (each.module, name.name) in _IMPORTED)
            yield from ((each.lineno, f"Python 3 has no {each.module}.{name}") for name in names)
        elif isinstance(each, ast.Name) and each.id in _NAMES - own and "*" not in own:
            yield each.lineno, f"Python 3 has no {each.id}"


def _for_both(each: ast.AST) -> bool:
    """Returns whether a part of a program may be meant for Python 2 and 3."""
    if isinstance(each, ast.If | ast.IfExp):
        words = {word for one in ast.walk(each.test) for word in (getattr(one, "id", ""), getattr(one, "attr", ""))}
        return any("version" in word or word.startswith("PY") for word in words)
    return isinstance(each, ast.Try)


_IMPORTS = (ast.Import, ast.ImportFrom)
_DEFINITIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
