"""Makes a program of an environment of PufferLib's Ocean, in C and without its drawing."""

import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

SOURCE = Path(__file__).with_name("ocean_robots.c")


class Environment(NamedTuple):
    """An environment of Ocean.

    Attributes:
        header: Its header below PufferLib's folder.
        drawing: What its drawing begins with: all from there on is left out.
        macro: What `ocean_robots.c` knows it by.
        map: Below PufferLib's folder; empty if it has none.
    """

    header: str
    drawing: str
    macro: str
    map: str = ""


ENVIRONMENTS: Mapping[str, Environment] = {
    "target": Environment("ocean/target/target.h", "// Required function. Should handle creating", "TARGET"),
    "gpudrive": Environment(
        "ocean/gpudrive/gpudrive.h", "const Color STONE_GRAY", "DRIVE", "resources/gpudrive/map_942.bin"
    ),
}


def built(puffer: Path, name: str, folder: Path) -> Path:
    """Returns the program of an environment.

    Args:
        puffer: The folder `pufferlib` of its source distribution.
        name: Which environment.
        folder: Where to build it.

    Raises:
        ValueError: The header is another one: it has no such drawing.
        subprocess.CalledProcessError: There is no C compiler, or it refused.
    """
    environment, place = ENVIRONMENTS[name], folder / name
    place.mkdir()
    header, drawing, _ = (puffer / environment.header).read_text().partition(environment.drawing)
    if not drawing:
        raise ValueError(f"{environment.header}: no {environment.drawing!r}; it was written for PufferLib 3.0.0")
    (place / "environment.h").write_text(header)
    for absent in ("raylib.h", "raymath.h", "rlgl.h"):
        (place / absent).touch()
    command = ["cc", "-O3", "-march=native", f"-I{place}", f"-D{environment.macro}", str(SOURCE), "-lm", "-w"]
    subprocess.run([*command, "-o", str(place / "robots")], check=True)
    return place / "robots"
