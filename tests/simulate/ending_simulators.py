"""Processes that simulate nothing: each ends, or answers, as a test says."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pytest

from specs.data.world import World
from tasks.simulate.sandbox import process_pool
from tasks.simulate.sandbox.protocol import Answer, SentWorlds
from tasks.simulate.sandbox.simulator import SimulatorEnded, Told


def ended(*, beside_others: bool) -> SimulatorEnded:
    """Returns the end of a process, in nobody's code, that knew of chunks ahead or did not."""
    found = SimulatorEnded("the process ended with exit code 3", None, "")
    found.beside_others = beside_others
    return found


def use_simulators(monkeypatch: pytest.MonkeyPatch, ends: Sequence[SimulatorEnded | Answer | Told]) -> list[object]:
    """Returns the questions that processes are asked, of which each is asked once and does what stands next."""
    asked, left = list[object](), iter(ends)

    class Process:
        alive = True

        def __init__(self, bundles: Mapping[str, Path]) -> None:
            self.bundles = bundles

        def ask(self, work: object, *, on_answer: Callable[..., None] = print) -> Told:
            assert callable(on_answer)
            asked.append(work)
            self.alive = False
            end = next(left)
            if isinstance(end, SimulatorEnded):
                raise end
            return end if isinstance(end, tuple) else (end, ())

        def sent_worlds(self, worlds: Mapping[str, World]) -> SentWorlds:
            return SentWorlds(new={name: world.model_dump_json() for name, world in worlds.items()})

        def end(self) -> None:
            self.alive = False

    monkeypatch.setattr(process_pool, "Simulator", Process)
    return asked
