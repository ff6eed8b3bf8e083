"""How many requests `simyard serve` answers for many clients at once, and whether it loses any.

    .venv/bin/python -m benchmarks.gateway.load [--requests N] [--clients N] [--document docs/operate/scale.md]

Clients sign their requests. Each makes robots, simulation jobs, templates and fleets in turn, and describes what it
made; nobody works the jobs off. Then the store is compared with the answers: each answered Create has a record, and
each record an answered Create.
"""

import json
import statistics
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from http.client import HTTPConnection, HTTPException
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from benchmarks.harness import machine, markdown, options, show
from specs.arn import ResourceKind, parse_reference
from specs.robomaker.operations import OPERATIONS
from tasks.deploy.fleet.fleet_registry import fleets, robots
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import records
from tasks.storage.store_url import open_store
from tasks.storage.templates import named_templates

if TYPE_CHECKING:
    from tests.factories.gateway.served import Served

_PLACE = "many clients at once"
_QUOTAS = {f"SIMYARD_MAX_{name}": "1000000" for name in ("SIMULATION_JOBS", "TEMPLATES", "FLEETS", "ROBOTS")}
_ROBOT = {"architecture": "X86_64", "greengrassGroupId": "none"}
_CYCLE = 10
_FIRST = "first"
_FLEET_EVERY = 5
_THERE: dict[ResourceKind, Callable[[Store], set[str]]] = {
    "robot": lambda store: {each.name for each in robots(store)},
    "deployment-fleet": lambda store: {each.name for each in fleets(store)},
    "world-template": lambda store: {each.id for each in named_templates(store)},
    "simulation-job": lambda store: {f"{each.id}/0" for each in records(store, "simulation-job-batch")},
}
Request = tuple[str, dict[str, Any]]


class Told(NamedTuple):
    """What a client was answered: an operation, how long it took, the ARN of what was made, an error if any."""

    operation: str
    took_s: float
    arn: str
    error: str


class Client:
    """Sends signed requests on a connection that it keeps.

    Args:
        gateway: What answers.
        number: Which of the clients it is.
    """

    def __init__(self, gateway: "Served", number: int) -> None:
        self._gateway, self._number = gateway, number
        self._connection = HTTPConnection("127.0.0.1", gateway.port, timeout=120)

    def work(self, requests: int, material: dict[str, Any]) -> Iterator[Told]:
        """Makes and describes things in turn, and yields each answer."""
        last: Request = ("DescribeRobot", {"robot": ""})
        for number in range(requests):
            name = f"c{self._number}-{number}"
            made = _creation(number, name, material)
            told = self._told(*(made or last))
            if made and told.arn:
                kind = made[0].removeprefix("Create")
                member = {"SimulationJob": "job", "WorldTemplate": "template"}.get(kind, kind.lower())
                last = (f"Describe{kind}", {member: told.arn})
            yield told

    def _told(self, operation: str, members: dict[str, Any]) -> Told:
        signed = self._gateway.signed(OPERATIONS[operation].path, json.dumps(members).encode())
        began_s = time.perf_counter()
        try:
            self._connection.request(signed.method, signed.raw_path, signed.body, dict(signed.headers))
            answer = self._connection.getresponse()
            document = json.loads(answer.read())
        except (OSError, HTTPException, ValueError) as exc:
            self._connection.close()
            return Told(operation, time.perf_counter() - began_s, "", repr(exc))
        error = "" if answer.status == 200 else f"{answer.status} {document.get('message')}"
        made = document.get("arn", "") if operation.startswith("Create") else ""
        return Told(operation, time.perf_counter() - began_s, made, error)


def _creation(number: int, name: str, material: dict[str, Any]) -> Request | None:
    """Returns what is made at that place of a client's work; None where the last thing is described."""
    cycle, place = divmod(number, _CYCLE)
    if place in {0, 4}:
        return "CreateRobot", {"name": name, **_ROBOT}
    if place == 2:
        return "CreateSimulationJob", {**material["job"], "clientRequestToken": name}
    if place == 6:
        return "CreateWorldTemplate", {"name": name, "templateBody": material["template"]}
    return ("CreateFleet", {"name": name}) if place == 8 and cycle % _FLEET_EVERY == 0 else None


def material_of(store: Store) -> dict[str, Any]:
    """Returns what jobs and templates are made of; the store has the applications and the world."""
    from tests.flows.gateway.asked import TEMPLATE, Asked  # noqa: PLC0415 - only here

    asked = Asked(store)
    world = asked.world()
    asked.call("CreateSimulationJob", **asked.job_request(world, clientRequestToken=_FIRST))  # it brings them
    return {"job": asked.job_request(world), "template": TEMPLATE.read_text()}


def lost(store: Store, told: Sequence[Told]) -> dict[str, int]:
    """Returns how many answered Creates have no record, and how many records no answered Create."""
    answered: dict[str, set[str]] = {kind: set() for kind in _THERE}
    for each in told:
        if each.arn:
            found = parse_reference(each.arn)
            answered[str(found.kind)].add(found.path)
    there = {kind: names(store) for kind, names in _THERE.items()}
    there["simulation-job"] -= {_first(store)}
    return {
        "answered, and not there": sum(len(answered[kind] - there[kind]) for kind in _THERE),
        "there, and not answered": sum(len(there[kind] - answered[kind]) for kind in _THERE),
    }


def _first(store: Store) -> str:
    return next(f"{each.id}/0" for each in records(store, "simulation-job-batch") if each.token == _FIRST)


def tables(told: Sequence[Told], took_s: float, losses: dict[str, int], memory_mb: tuple[float, float]) -> str:
    """Returns what was measured, as tables."""
    head = ("operation", "requests", "median, ms", "99 %, ms")
    rows: list[tuple[str, ...]] = [head]
    for name in dict.fromkeys(each.operation for each in told):
        times = sorted(each.took_s for each in told if each.operation == name)
        late = times[min(len(times) - 1, round(0.99 * len(times)))]
        rows.append((name, f"{len(times):,}", f"{1000 * statistics.median(times):.0f}", f"{1000 * late:.0f}"))
    errors = [each for each in told if each.error]
    says = [f"{len(told):,} requests in {took_s:.0f} s: {len(told) / took_s:.0f} a second. Errors: {len(errors)}."]
    says += [f"{what.capitalize()}: {count}." for what, count in losses.items()]
    says.append(f"The gateway had {memory_mb[0]:.0f} MB before, and never more than {memory_mb[1]:.0f} MB.")
    return f"{machine()} {' '.join(says)}\n\n{markdown(rows)}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Measures, and prints the tables or writes them into a document."""
    from tests.factories.gateway.served import served  # noqa: PLC0415 - only here

    parser = options(__doc__)
    parser.add_argument("--requests", type=int, default=10_000)
    parser.add_argument("--clients", type=int, default=50)
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder, served(Path(folder) / "gateway", settings=_QUOTAS) as gateway:
        store = open_store(gateway.store.as_uri())
        material, before_mb = material_of(store), gateway.memory_mb()
        start = threading.Barrier(given.clients)

        def work(number: int) -> list[Told]:
            start.wait()
            return list(Client(gateway, number).work(given.requests // given.clients, material))

        began_s = time.perf_counter()
        with ThreadPoolExecutor(given.clients) as pool:
            told = [each for part in pool.map(work, range(given.clients)) for each in part]
        took_s = time.perf_counter() - began_s
        text = tables(told, took_s, lost(store, told), (before_mb, gateway.memory_mb()))
    show(_PLACE, text, given.document)
    for each in [each for each in told if each.error][:10]:
        print(each)


if __name__ == "__main__":
    main()
