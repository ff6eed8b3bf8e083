"""The steady clock of C++ nodes in simulated time: the library that is preloaded into them, and the variable for it.

Wall timers and ``rclcpp::WallRate``, ``std::this_thread::sleep_for`` and limits of the C++ library count by the
machine's steady clock. In lock-step that is another control step on each machine. ``steady_clock.c`` says what stands
in between. A C compiler makes it anew for each chunk, in a fraction of a second; who writes nodes in C++ has one.
"""

import os
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path

_SOURCE, _NAME, _PRELOAD = Path(__file__).with_name("steady_clock.c"), "steady_clock.so", "LD_PRELOAD"
_COMPILERS = ("cc", "gcc", "clang")
# Without the C library's name and versions: that of a container image may be older.
_OPTIONS = (
    "-O2",
    "-shared",
    "-fPIC",
    "-nostdlib",
    "-fvisibility=hidden",
    "-fno-stack-protector",
    "-ftls-model=initial-exec",
)
_LIMIT_S = 60.0
NO_COMPILER = "wall timers of rclcpp go by the machine's clock, for there is no C compiler: install gcc and libc6-dev"


def c_compiler() -> str:
    """Returns the C compiler that is here; empty without one."""
    path = os.pathsep.join((os.environ.get("PATH", ""), os.defpath))
    return next(filter(None, (shutil.which(each, path=path) for each in _COMPILERS)), "")


def build_steady_clock(folder: Path) -> str:
    """Makes the library in a folder; returns why it cannot be made, for a person."""
    if not (compiler := c_compiler()):
        return NO_COMPILER
    command = [compiler, *_OPTIONS, "-o", str(folder / _NAME), str(_SOURCE)]
    try:
        subprocess.run(command, capture_output=True, timeout=_LIMIT_S, check=True)  # noqa: S603 - of this module's making
    except (OSError, subprocess.SubprocessError) as exc:
        said = (getattr(exc, "stderr", None) or b"").decode(errors="replace").strip()
        why = said.partition("\n")[0][:300] or str(exc)
        return f"wall timers of rclcpp go by the machine's clock, for {compiler} fails: {why}"
    return ""


def with_steady_clock(folder: Path, home: Path, variables: Mapping[str, str]) -> dict[str, str]:
    """Returns nodes' variables with the library preloaded, if it was made.

    Args:
        folder: Where it was made.
        home: The episode's folder, which an image sees by the same name; the library is put there.
        variables: What they have without.
    """
    if not (folder / _NAME).is_file():
        return dict(variables)
    own = home / _NAME
    if not own.exists():  # nodes of the other application may have begun, and would be running what is written
        shutil.copy(folder / _NAME, own)
    return {**variables, _PRELOAD: " ".join(filter(None, (str(own), variables.get(_PRELOAD, ""))))}
