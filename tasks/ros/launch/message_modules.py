"""Python modules of the message packages that nodes import and nobody installs: RoboMaker's, and Gazebo's.

ROS's own generator makes them of Simyard's definitions. What a bundle builds, or a machine has, goes before them.
"""

import json
from pathlib import Path

from tasks.ros.launch.launch_plan import run_launch_program
from tasks.ros.launch.packages import RosInstallation
from tasks.ros.message.definition import MESSAGES, SERVICES

PACKAGES = ("gazebo_msgs", "robomaker_simulation_msgs")
_LIMIT_S = 60.0
_MOST_BYTES = 1 << 20
# Runs in ROS's own Python: definitions come as input, the modules go to a folder.
_PROGRAM = """
import json, os, sys
import genpy.generator, genpy.generate_initpy
folder, files = sys.argv[1], json.load(sys.stdin)
for name, text in files.items():
    os.makedirs(os.path.dirname(os.path.join(folder, name)), exist_ok=True)
    with open(os.path.join(folder, name), "w") as file:
        file.write(text)
search = {}
for name in files:
    search.setdefault(name.split("/")[0], [os.path.join(folder, name.split("/")[0], "msg")])
for package in sys.argv[2:]:
    for kind, make in (("msg", genpy.generator.MsgGenerator), ("srv", genpy.generator.SrvGenerator)):
        own = [os.path.join(folder, name) for name in sorted(files) if name.startswith("%s/%s/" % (package, kind))]
        made = os.path.join(folder, "python", package, kind)
        if make().generate_messages(package, own, made, search):
            sys.exit("no modules of %s" % package)
        genpy.generate_initpy.write_modules(made)
    open(os.path.join(folder, "python", package, "__init__.py"), "w").close()
print("\\ndone")
"""


def named_packages(bundle: Path) -> list[str]:
    """Returns the packages of these that a bundle's files name."""
    files = [path for path in sorted(bundle.rglob("*")) if path.is_file() and path.stat().st_size <= _MOST_BYTES]
    return [name for name in PACKAGES if any(name.encode() in path.read_bytes() for path in files)]


def make_message_modules(folder: Path, installation: RosInstallation, packages: list[str]) -> Path | None:
    """Makes the modules of packages that ROS does not have, and returns the folder to import them from.

    Args:
        folder: To make them in.
        installation: The ROS whose Python imports them.
        packages: Of ``PACKAGES``.

    Raises:
        LaunchRefused: ROS's generator does not answer.
    """
    missing = [name for name in packages if not (installation.prefix / "share" / name / "package.xml").is_file()]
    if not missing:
        return None
    files = {f"{_place(kind, 'msg')}.msg": text for kind, text in MESSAGES.items()}
    files |= {f"{_place(kind, 'srv')}.srv": "\n---\n".join(text) for kind, text in SERVICES.items()}
    folder.mkdir(parents=True, exist_ok=True)
    command = [str(installation.python), "-c", _PROGRAM, str(folder), *missing]
    own = {**installation.environment(), "HOME": str(folder), "LANG": "C.UTF-8", "PYTHONDONTWRITEBYTECODE": "1"}
    run_launch_program(command, own, folder, json.dumps(files), _LIMIT_S)
    return folder / "python"


def _place(kind: str, folder: str) -> str:
    package, _, name = kind.partition("/")
    return f"{package}/{folder}/{name}"
