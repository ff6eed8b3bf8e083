"""What keeps an application's module from being imported, read from its sources, so that checking runs nothing of it.

Only what always happens is looked at: an import in a function, a branch or a ``try`` may never be reached.
"""

import ast
from collections.abc import Iterator
from importlib.machinery import EXTENSION_SUFFIXES, SOURCE_SUFFIXES
from importlib.util import find_spec
from pathlib import Path, PurePosixPath

from specs.launched_file import module_file

_SUFFIXES = (*SOURCE_SUFFIXES, *EXTENSION_SUFFIXES)
_Bound = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


def module_fault(folder: Path, package: str, file: str, factories: tuple[str, ...], *, installed: bool) -> str:
    """Returns why a module cannot be launched; empty if nothing is seen.

    Args:
        folder: The bundle.
        package: What is launched: the package.
        file: And its module, as a document names it.
        factories: Names of functions one of which it must define.
        installed: Whether it is imported with the libraries of this process, so that one that is not here is missed.
    """
    check, name = _Check(folder, installed=installed), PurePosixPath(module_file(package, file))
    inits = [parent / "__init__.py" for parent in [*name.parents][-2::-1]]  # which are imported before it
    for each in [*(init for init in inits if (folder / init).is_file()), name]:
        if why := check.file(each):
            return why
    tree = check.trees.get(name)
    if tree is None or any(_binds(node, factories) for node in ast.walk(tree)):
        return ""
    return f"{name} defines no function {factories[0]}(environment)"


class _Check:
    """Follows a module's imports through its bundle.

    Attributes:
        trees: The modules that were read, by their path in the bundle.
    """

    def __init__(self, folder: Path, *, installed: bool) -> None:
        self._folder, self._installed = folder, installed
        self.trees: dict[PurePosixPath, ast.Module] = {}

    def file(self, name: PurePosixPath) -> str:
        """Returns why a module of the bundle does not import; empty if nothing is seen, or if it was seen before."""
        if name in self.trees:
            return ""
        path = self._folder / name
        try:
            source = path.read_bytes()
            compile(source, path.name, "exec", dont_inherit=True)
            self.trees[name] = ast.parse(source)
        except SyntaxError as exc:
            return f"{name}, line {exc.lineno}: {exc.msg}"
        except (OSError, ValueError, RecursionError, MemoryError) as exc:
            return f"{name}: {exc}"
        if any(map(_moves_search, ast.walk(self.trees[name]))):
            self._installed = False  # nobody knows where it looks for libraries then
        found = (why for node in self.trees[name].body for why in self._statement(name, node))
        return next(found, "")

    def _statement(self, name: PurePosixPath, node: ast.stmt) -> Iterator[str]:
        """Yields what is wrong with a statement of a module, if it is an import."""
        where = f"{name}, line {node.lineno}"
        if isinstance(node, ast.Import):
            wanted = [each.name for each in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level:
            wanted = [node.module or ""]
        elif isinstance(node, ast.ImportFrom):
            yield from self._relative(name, where, node)
            return
        else:
            return
        for each in wanted:
            if self._installed and not _is_installed(top := each.partition(".")[0]):
                yield f"{where}: no library {top} is installed here{self._beside(name, each)}"

    def _beside(self, name: PurePosixPath, wanted: str) -> str:
        """Returns how to import a module of the bundle that is named as a library is; else that it may be installed."""
        top = wanted.partition(".")[0]
        if self._module(name.parent / top):
            return f"; import the module beside it as from . import {top}"
        if self._module(PurePosixPath(top)):
            return "; a bundle's modules import one another relatively, such as from ..package import module"
        return f": pip install {top}, or put it into the bundle and import it relatively"

    def _relative(self, name: PurePosixPath, where: str, node: ast.ImportFrom) -> Iterator[str]:
        """Yields what is wrong with ``from .module import name``."""
        if node.level > len(name.parents):
            yield f"{where}: that is beyond the bundle"
            return
        base = name.parents[node.level - 1].joinpath(*(node.module or "").split("."))
        if not node.module and (self._folder / base / "__init__.py").is_file():
            return  # which may define whatever is imported
        wanted = [base] if node.module else [base / each.name for each in node.names]
        for each in wanted:
            found = self._module(each)
            if found is None:
                yield f"{where}: the bundle has no {each}.py"
            elif found.suffix == ".py" and (why := self.file(found)):
                yield why

    def _module(self, path: PurePosixPath) -> PurePosixPath | None:
        """Returns the file, or the folder, of a module in the bundle; None if it has none."""
        package = path / "__init__.py"
        names = [package, *(path.with_name(path.name + suffix) for suffix in _SUFFIXES), path]
        return next((each for each in names if (self._folder / each).exists()), None)


def _is_installed(top: str) -> bool:
    """Returns whether this process would find a library; it is not imported."""
    try:
        return find_spec(top) is not None
    except (ImportError, ValueError):  # of a module that is loaded already, and has no specification
        return True


def _moves_search(node: ast.AST) -> bool:
    """Returns whether a module changes where Python looks for others, as by ``sys.path.append``."""
    if isinstance(node, ast.ImportFrom):
        return node.module in {"sys", "site"} and not node.level
    names = {"path", "meta_path", "path_hooks", "modules", "addsitedir"}
    return isinstance(node, ast.Attribute) and node.attr in names and getattr(node.value, "id", "") in {"sys", "site"}


def _binds(node: ast.AST, names: tuple[str, ...]) -> bool:
    """Returns whether a statement may give a module one of some names."""
    if isinstance(node, _Bound):
        return node.name in names or node.name == "__getattr__"
    if isinstance(node, ast.alias):
        return (node.asname or node.name.partition(".")[0]) in names or node.name == "*"
    if isinstance(node, ast.Name):
        return node.id in {*names, "globals", "exec", "setattr"}
    return False
