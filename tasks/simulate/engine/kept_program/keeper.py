"""Keeps the functions of a program from one process to the next: what one process has traced, the next one loads.

A function is kept as StableHLO (``jax.export``): the machine code that XLA makes of it lies in JAX's own cache, whose
key follows from those bytes, so that a process that loads both neither traces, lowers nor compiles
(docs/decisions/0041-programs-without-tracing.md). The process that traces runs what it kept, so that all run the same.
"""

import hashlib
import json
import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
from jax import export
from jax.sharding import NamedSharding

from specs.data.engine_name import EngineName
from tasks.simulate.engine.kept_program.identity import machine_identity
from tasks.simulate.engine.kept_program.kept_file import Head, KeptFile, read_kept, write_kept
from tasks.simulate.engine.kept_program.module_files import module_dependencies
from tasks.simulate.engine.kept_program.tree_form import FormUnknown, form_text, tree_of
from tasks.simulate.lane.calls import Applications

logger = logging.getLogger(__name__)
# Raised when what is kept changes its form.
_FORMAT = 1
Function = Callable[..., Any]
Told = Callable[[], None]
_folders: list[Path] = []
_told: list[Told] = []


def use_program_folder(folder: Path, on_compile: Told = lambda: None) -> None:
    """Keeps programs in a folder from now on.

    Args:
        folder: No other applications than this process's may write to it.
        on_compile: Called before a function is traced and compiled that is not kept there.
    """
    _folders[:], _told[:] = [folder], [on_compile]


def program_keeper(
    sharding: NamedSharding, applications: Applications, engine: EngineName, *, host: bool
) -> "ProgramKeeper":
    """Returns the keeper of a program's functions.

    Args:
        sharding: How their arrays are split over the devices.
        applications: The robot application and the scenario.
        engine: That drives them.
        host: Whether the robot application runs on the host.
    """
    known = applications.identity
    return ProgramKeeper(sharding, json.dumps([known, engine, host, repr(applications.sensors)]) if known else "")


@dataclass(frozen=True)
class ProgramKeeper:
    """Keeps the functions of one program.

    Attributes:
        sharding: How all their arrays, lanes first, are split over the devices.
        identity: What they follow from besides the shapes of their arrays; empty for a program that is not kept.
    """

    sharding: NamedSharding
    identity: str

    def kept(self, name: str, function: Function) -> Function:
        """Returns a function to be compiled, which is traced only if no process has kept it before.

        Args:
            name: Of the function, within the program.
            function: Takes and returns trees of arrays, with no type of an application's own (``sealed_state``); at
                least one that it takes lies on the devices.
        """
        if not self.keeps:
            return function

        def called(*given: Any) -> Any:  # noqa: ANN401 - as the function has them
            return self._called(name, function, given)

        called.__name__ = called.__qualname__ = name
        return called

    @property
    def keeps(self) -> bool:
        """Returns whether anything is kept."""
        return bool(self.identity and _folders)

    def passed(self, check: str, arguments: object, values: object = None) -> bool:
        """Returns whether a check was passed before, by this process or another.

        Args:
            check: Its name.
            arguments: Arrays of which it sees the shapes.
            values: What else it sees.
        """
        return self.keeps and read_kept(_folders[0], self._key(f"{check} {values!r}", arguments)) is not None

    def note(self, check: str, arguments: object, values: object = None) -> None:
        """Notes that a check was passed; the arguments are those of ``passed``."""
        if self.keeps:
            kept = KeptFile(Head(dependencies=module_dependencies()), b"")
            write_kept(_folders[0], self._key(f"{check} {values!r}", arguments), kept)

    def _called(self, name: str, function: Function, arguments: tuple[Any, ...]) -> Any:  # noqa: ANN401 - as it has them
        """Returns what a function returns of traced arguments, out of what is kept of it."""
        key = self._key(name, arguments)
        kept = read_kept(_folders[0], key)
        if kept is not None and kept.head.whole:
            try:
                return _result(kept, arguments)
            except Exception as exc:  # noqa: BLE001 - whatever lies in the file: it is made anew
                logger.debug("what is kept of %s cannot be loaded: %s", name, exc)
                kept = None
        if kept is None:
            for tell in _told:
                tell()
            kept = self._traced(function, arguments)
            write_kept(_folders[0], key, kept)
        return _result(kept, arguments) if kept.head.whole else function(*arguments)

    def _traced(self, function: Function, arguments: tuple[Any, ...]) -> KeptFile:
        """Returns a function as it can be kept; what it raises while it is traced is raised here."""
        leaves, structure = jax.tree.flatten(arguments)
        made: list[Any] = []

        def flat(*arrays: jax.Array) -> list[jax.Array]:
            results, form = jax.tree.flatten(function(*jax.tree.unflatten(structure, arrays)))
            made[:] = [form]
            return results

        shapes = [_shape(leaf, self.sharding) for leaf in leaves]
        compiled = jax.jit(flat)
        compiled.trace(*shapes)  # an application's exceptions come from here, and no others
        try:
            form, program = form_text(made[0]), bytes(export.export(compiled)(*shapes).serialize())
        except (NotImplementedError, ValueError, FormUnknown) as exc:  # such as one that calls the host back
            logger.debug("a program cannot be kept: %s", exc)
            return KeptFile(Head(whole=False, dependencies=module_dependencies()), b"")
        return KeptFile(Head(form=form, dependencies=module_dependencies()), program)

    def _key(self, name: str, arguments: object) -> str:
        leaves, structure = jax.tree.flatten(arguments)
        shapes = [(leaf.shape, str(leaf.dtype), _is_weak(leaf)) for leaf in leaves]
        told = [_FORMAT, machine_identity(), self.identity, name, str(self.sharding), str(structure), shapes]
        return hashlib.sha256(json.dumps(told).encode()).hexdigest()


def _result(kept: KeptFile, arguments: tuple[Any, ...]) -> Any:  # noqa: ANN401 - whatever the kept function returns
    results: Any = export.deserialize(bytearray(kept.program)).call(*jax.tree.leaves(arguments))
    return tree_of(kept.head.form, results)


def _shape(leaf: jax.Array, sharding: NamedSharding) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(leaf.shape, leaf.dtype, sharding=sharding, weak_type=_is_weak(leaf))


def _is_weak(leaf: object) -> bool:
    return bool(getattr(leaf, "weak_type", False))
