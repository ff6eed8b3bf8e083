"""How long the owner waits for DescribeFleet while one key that may only read reloads a page on many connections.

.venv/bin/python -m benchmarks.gateway.crowd [--connections N] [--worlds N] [--seconds N]

The store is a folder with worlds; each answer has a page of them.
"""

import http.client
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.harness import machine, markdown, options, show

if TYPE_CHECKING:
    from tests.factories.gateway.served import Served

_PLACE = "one key on many connections"
_FLEET = b'{"fleet": "arn:aws:robomaker:us-west-2:123456789012:deployment-fleet/home"}'
_BEFORE, _BETWEEN_S = 100, 0.05


def owner_waits_s(gateway: "Served") -> float:
    """Returns how long a request of the owner took."""
    signed, began_s = gateway.signed("/describeFleet", _FLEET), time.perf_counter()
    if gateway.send(signed)[0] != 200:
        raise SystemExit("the owner was refused")
    return time.perf_counter() - began_s


def reload(gateway: "Served", cookie: str, until_s: float, told: Counter[int]) -> None:
    """Asks for a page until a time, and counts the statuses of the answers."""
    connection = http.client.HTTPConnection("127.0.0.1", gateway.port, timeout=600)
    while time.monotonic() < until_s:
        try:
            connection.request("GET", "/worlds", headers={"host": gateway.host, "cookie": cookie})
            answer = connection.getresponse()
            answer.read()
            told[answer.status] += 1
        except (OSError, http.client.HTTPException):
            connection.close()


def row(name: str, waits_s: Sequence[float]) -> tuple[str, ...]:
    """Returns a row of the table."""
    found = sorted(waits_s)
    marks = (found[len(found) // 2], found[int(0.99 * len(found))], found[-1])
    return (name, f"{len(found):,}", *(f"{1000 * wait_s:,.0f}" for wait_s in marks))


def main(arguments: Sequence[str] | None = None) -> None:
    """Measures, and prints the table or writes it into a document."""
    from tests.factories.gateway.served import served  # noqa: PLC0415 - only here

    parser = options(__doc__)
    parser.add_argument("--connections", type=int, default=200)
    parser.add_argument("--worlds", type=int, default=5000)
    parser.add_argument("--seconds", type=float, default=60.0)
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder, served(Path(folder) / "gateway") as gateway:
        gateway.send(gateway.signed("/createFleet", b'{"name": "home"}'))
        for number in range(given.worlds):
            world = gateway.store / "worlds" / f"g{number // 50}" / f"w{number % 50}.json"
            world.parent.mkdir(parents=True, exist_ok=True)
            world.write_bytes(b"{}")
        quiet, crowded, told = [owner_waits_s(gateway) for _ in range(_BEFORE)], list[float](), Counter[int]()
        until_s, cookie = time.monotonic() + given.seconds, gateway.signed_in(gateway.key("reader", "read"))
        for _ in range(given.connections):
            threading.Thread(target=reload, args=(gateway, cookie, until_s, told), daemon=True).start()
        while time.monotonic() < until_s:
            crowded.append(owner_waits_s(gateway))
            time.sleep(_BETWEEN_S)
    head = ("DescribeFleet of the owner", "requests", "median, ms", "99 %, ms", "longest, ms")
    rows = (head, row("alone", quiet), row(f"beside {given.connections} connections of one key", crowded))
    says = ", ".join(f"{count:,} with {status}" for status, count in sorted(told.items()))
    show(_PLACE, f"{machine()} The other key's requests were answered {says}.\n\n{markdown(rows)}", given.document)


if __name__ == "__main__":
    main()
