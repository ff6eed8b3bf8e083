"""A controller in plain Python that does, in its second step, what FAULT says, and drives on otherwise."""
# ruff: noqa: ARG002, T201 - the arguments are the contract's, and printing is what it is there for

import os
import socket
import struct
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

jax = False
DRIVEN = [0.4, 0.0, 0.3]


class Lidar(NamedTuple):
    rays: int = 8
    range_m: float = 6.0
    height_m: float = 0.25


def _leave() -> object:
    os._exit(0)


def _sleep() -> object:
    while True:
        time.sleep(1.0)


def _interrupt() -> object:
    raise KeyboardInterrupt


def _tell_environment() -> object:
    raise RuntimeError(" ".join(sorted(os.environ)))


def _write_file() -> object:
    # Beside its own code, in the folder above, and where everybody may write.
    places = (Path(__file__).parent, Path(__file__).parents[1], Path(sys.prefix), Path("/usr"))
    for place in places:
        try:
            (place / "written.txt").write_text("here I was")
        except OSError:
            continue
        raise RuntimeError(f"wrote into {place.name}")
    return DRIVEN


def _connect() -> object:
    with socket.socket() as connection:
        connection.settimeout(2.0)
        connection.connect(("127.0.0.1", int(os.environ.get("PORT", "9"))))
    return DRIVEN


def _look_at_parent() -> object:
    seen = [Path(f"/proc/{number}/environ").read_bytes() for number in (os.getppid(), 1) if number != os.getpid()]
    raise RuntimeError(
        f"read {sum(map(len, seen))} bytes, SIMYARD_KEYS {any(b'SIMYARD_KEYS' in each for each in seen)}"
    )


def _print() -> object:
    print("I see something " * 3)
    sys.stdout.close()
    print("and say it to nobody", file=sys.stderr)
    return DRIVEN


def _announce() -> object:
    # To whoever asks the process, by whatever socket it has: JSON of 600 MB, which never comes.
    for handle in Path("/proc/self/fd").iterdir():
        if handle.is_socket():
            os.write(int(handle.name), struct.pack("<QQ", 600 << 20, 0))
    time.sleep(600)  # whoever asks is to hear of it in this call
    return DRIVEN


FAULTS: Mapping[float, Callable[[], object]] = {
    1.0: _leave,
    2.0: _sleep,
    3.0: _interrupt,
    4.0: _tell_environment,
    5.0: _write_file,
    6.0: _connect,
    7.0: _look_at_parent,
    8.0: _print,
    9.0: lambda: sys.exit(0),
    10.0: lambda: [0.4 + 1j, 0.0, 0.0],
    11.0: lambda: None,
    12.0: lambda: [True, False, True],
    13.0: lambda: ("a", "b", "c"),
    14.0: _announce,
}


class Driving:
    lidar = Lidar()

    def __init__(self, fault: float) -> None:
        self._fault, self._steps = float(fault), 0

    def reset(self, floor: object, goals_m: object) -> None:
        self._steps = 0

    def step(self, observation: object) -> object:
        self._steps += 1
        return FAULTS[self._fault]() if self._steps == 2 and self._fault else DRIVEN


def controller(environment: Mapping[str, float]) -> Driving:
    return Driving(environment["FAULT"])
