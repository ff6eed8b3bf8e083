"""Where the time of `simyard run examples/quickstart.yaml` goes: the wall's and the processor's, step by step.

    .venv/bin/python -m benchmarks.quickstart [--warm-runs N] [--cache FOLDER] [--direct] [--document PAGE]

Each run is the command itself, with a new store. The first one has an empty cache folder (no compiled programs, no
Prefect database, no unpacked bundles) and is not timed if FOLDER is kept from before; the warm runs share what it left.
The steps and their times are those of the run's log (SIMYARD_LOG_FORMAT); the processor's are the kernel's, of the run
and of all that it starts. Where several steps pass at a time, a line names them all. The table is of the median run.
"""

import itertools
import json
import os
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from benchmarks.harness import ROOT, machine, markdown, options, show
from benchmarks.process_times import KINDS, Ran, run_watched, spent_between

DOCUMENT = "examples/quickstart.yaml"
AIM_S = 18.0
_KINDS = ("run", *KINDS.values(), "others")
# Stages as the log names them; their steps are in the table instead.
_AROUND = frozenset({"world_generation", "world_export", "simulation_batch", "deployment_sync"})
_LEAST_S = 0.05


class Step(NamedTuple):
    """A step of a run, in seconds since the run began."""

    name: str
    begin_s: float
    end_s: float


class Span(NamedTuple):
    """A time in which the same steps were under way, and what each kind of process took in it."""

    name: str
    begin_s: float
    end_s: float
    spent_s: Mapping[str, float]


def run_once(cache: Path, *options: str) -> Ran:
    """Returns what one run took, with a store of its own."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PREFECT_", "SIMYARD_"))}
    settings = {"SIMYARD_CACHE": str(cache), "SIMYARD_LOG_FORMAT": "json", "PYTHONPATH": str(ROOT)}
    with tempfile.TemporaryDirectory(prefix="simyard-bench-") as folder:
        command = [sys.executable, "-m", "simyard", "run", DOCUMENT, "--store", (Path(folder) / "store").as_uri()]
        return run_watched([*command, *options], {**kept, **settings}, ROOT)


def steps_of(ran: Ran) -> list[Step]:
    """Returns the steps that a run's log names, by their beginnings."""
    found: list[Step] = []
    for line in ran.lines:
        if not line.startswith("{"):
            continue
        event = json.loads(line)
        if "step" in event and event["step"] not in _AROUND:
            end_s = datetime.fromisoformat(event["time"]).timestamp() - ran.began_s
            found.append(Step(event["step"], end_s - event["seconds"], end_s))
    return sorted(found, key=lambda step: step.begin_s)


def spans_of(ran: Ran) -> list[Span]:
    """Returns the whole time of a run, cut where a step begins or ends."""
    steps, wall_s = steps_of(ran), ran.ended_s - ran.began_s
    marks = sorted({0.0, wall_s, *(step.begin_s for step in steps), *(step.end_s for step in steps)})
    spans = list(_spans(ran, steps, marks))
    joined: list[Span] = []
    for span in spans:
        if joined and joined[-1].name == span.name:
            before = joined.pop()
            both = {kind: before.spent_s.get(kind, 0.0) + span.spent_s.get(kind, 0.0) for kind in _KINDS}
            joined.append(Span(span.name, before.begin_s, span.end_s, both))
        else:
            joined.append(span)
    return joined


def _spans(ran: Ran, steps: Sequence[Step], marks: Sequence[float]) -> Iterator[Span]:
    for begin_s, end_s in itertools.pairwise(marks):
        middle_s = (begin_s + end_s) / 2
        names = dict.fromkeys(step.name for step in steps if step.begin_s < middle_s < step.end_s)
        after = next((f"before {step.name}" for step in steps if step.begin_s >= end_s), "the rest")
        spent_s = spent_between(ran.looks, ran.began_s + begin_s, ran.began_s + end_s)
        yield Span(" + ".join(names) or after, begin_s, end_s, spent_s)


def timeline(ran: Ran) -> str:
    """Returns the table of a run."""
    spans, wall_s = spans_of(ran), ran.ended_s - ran.began_s
    total = {kind: sum(span.spent_s.get(kind, 0.0) for span in spans) for kind in _KINDS}
    head = ("step", "begins, s", "wall, s", *(f"{kind}, CPU s" for kind in _KINDS))
    rows = [_row(span.name, f"{span.begin_s:.1f}", span.end_s - span.begin_s, span.spent_s) for span in spans]
    shown = [row for row, span in zip(rows, spans, strict=True) if span.end_s - span.begin_s >= _LEAST_S]
    return markdown([head, *shown, _row("all", "", wall_s, total)])


def _row(name: str, begin: str, wall_s: float, spent_s: Mapping[str, float]) -> tuple[str, ...]:
    spent = (f"{spent_s.get(kind, 0.0):.1f}" if spent_s.get(kind, 0.0) >= _LEAST_S else "" for kind in _KINDS)
    return (name, begin, f"{wall_s:.1f}", *spent)


def report(cold: Ran | None, warm: Sequence[Ran]) -> str:
    """Returns the tables: the runs, and the timeline of the median one."""
    head = ("run", "wall, s", "CPU, s", "aim, wall, s")
    named = ([("cold", cold)] if cold else []) + [(f"warm {number + 1}", ran) for number, ran in enumerate(warm)]
    rows = [
        (name, f"{ran.ended_s - ran.began_s:.1f}", f"{ran.spent_s:.1f}", f"{AIM_S:.0f}" if name != "cold" else "")
        for name, ran in named
    ]
    middle = sorted(warm, key=lambda ran: ran.ended_s - ran.began_s)[(len(warm) - 1) // 2]
    return "\n\n".join([machine(), markdown([head, *rows]), timeline(middle)])


def main() -> None:
    """Prints the tables, and writes them into a page."""
    parser = options(__doc__)
    parser.add_argument("--warm-runs", type=int, default=3)
    parser.add_argument("--cache", type=Path)
    parser.add_argument("--direct", action="store_true")
    chosen = parser.parse_args()
    ways = ["--direct"] if chosen.direct else []
    with tempfile.TemporaryDirectory(prefix="simyard-cache-") as folder:
        cold = None if chosen.cache else run_once(Path(folder), *ways)
        warm = [run_once(chosen.cache or Path(folder), *ways) for _ in range(chosen.warm_runs)]
    show("quickstart", report(cold, warm), chosen.document)


if __name__ == "__main__":
    main()
