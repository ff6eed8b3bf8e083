"""What keeps an application's module from being imported."""

from hashlib import sha256
from pathlib import Path

import pytest

from specs.data.episode import ApplicationLaunch
from tasks.simulate.application.bundle_code import BundleCrash, load_factory
from tasks.simulate.application.module_check import module_fault
from tests.repository import ROOT

CONTROLLER = "def controller(environment): ...\n"
BESIDE = "import os, sys\nsys.path.append(os.path.dirname(__file__))\n"


def _bundle(folder: Path, **files: str) -> Path:
    for name, text in {"drive": CONTROLLER, **files}.items():
        path = folder / "bot" / f"{name}.py"
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    return folder


def _imports(folder: Path) -> bool:
    digest = sha256(str(folder).encode()).hexdigest()  # modules of one digest are imported once
    launch = ApplicationLaunch(name="bot", version="1", digest=digest, package="bot", launch_file="drive")
    try:
        load_factory(folder, launch, "controller", "RobotApplicationCrash")
    except BundleCrash:
        return False
    return True


@pytest.mark.parametrize(
    ("files", "why"),
    [
        ({"drive": f"import json\nimport no_such_lib.x\n{CONTROLLER}"}, "drive.py, line 2: no library no_such_lib is"),
        (
            {"drive": f"from no_such_lib import x\n{CONTROLLER}"},
            "no library no_such_lib is installed here: pip",
        ),
        ({"drive": f"import way\n{CONTROLLER}", "way": ""}, "import the module beside it as from . import way"),
        ({"drive": f"from bot import way\n{CONTROLLER}", "way": ""}, "import one another relatively"),
        ({"drive": f"from . import way\n{CONTROLLER}"}, "line 1: the bundle has no bot/way.py"),
        (
            {"drive": f"from .way import x\n{CONTROLLER}", "way": "\nimport no_such_lib\n"},
            "bot/way.py, line 2: no library",
        ),
        ({"drive": f"from .way import x\n{CONTROLLER}", "way": "x = (\n"}, "bot/way.py, line 1: '(' was never closed"),
        ({"drive": f"from ..gone import x\n{CONTROLLER}"}, "line 1: the bundle has no gone.py"),
        ({"drive": f"from ...gone import x\n{CONTROLLER}"}, "line 1: that is beyond the bundle"),
        ({"__init__": "import no_such_lib\n"}, "bot/__init__.py, line 1: no library no_such_lib"),
        ({"drive": "def control(environment): ...\n"}, "bot/drive.py defines no function controller(environment)"),
    ],
)
def test_a_module_that_does_not_import_is_told_with_its_line(tmp_path: Path, files: dict[str, str], why: str):
    folder = _bundle(tmp_path, **files)
    assert why in module_fault(folder, "bot", "drive", ("controller", "controllers"), installed=True)
    assert not _imports(folder)


@pytest.mark.parametrize(
    "files",
    [
        {"drive": f"try:\n    import no_such_lib\nexcept ImportError:\n    no_such_lib = None\n{CONTROLLER}"},
        {"drive": f"from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import no_such_lib\n{CONTROLLER}"},
        {"drive": "from .way import controller\n", "way": CONTROLLER},
        {"drive": "from .way import *\n", "way": CONTROLLER},
        {"drive": "from . import way\ncontroller = way.make\n", "way": "from . import drive\ndef make(e): ...\n"},
        {"drive": "from . import x\ncontroller = x\n", "__init__": "def x(environment): ...\n"},
        {"drive": f"from ..bot import way\nfrom ..bot.way import x\n{CONTROLLER}", "way": "x = 1\n"},
        {
            "drive": f"import os, sys\nsys.path.append(os.path.dirname(__file__))\nimport way_beside\n{CONTROLLER}",
            "way_beside": "",
        },
        {"drive": "import numpy.linalg, os.path, jax\ncontroller = lambda environment: None\n"},
    ],
)
def test_a_module_that_imports_is_let_pass(tmp_path: Path, files: dict[str, str]):
    folder = _bundle(tmp_path, **files)
    assert not module_fault(folder, "bot", "drive", ("controller", "controllers"), installed=True)
    assert _imports(folder)


def test_libraries_of_workers_elsewhere_are_not_looked_for_here(tmp_path: Path):
    folder = _bundle(tmp_path, drive=f"import no_such_lib\nfrom .gone import x\n{CONTROLLER}")
    assert "bundle has no bot/gone.py" in module_fault(folder, "bot", "drive", ("controller",), installed=False)


@pytest.mark.parametrize("name", ["courier/go_to_goal", "wanderer/wander", "delivery/rooms", "coverage/floor"])
def test_the_shipped_applications_pass(name: str):
    package, file = name.split("/")
    found = next((ROOT / "applications").glob(f"*/{name}.py"), None)
    assert found is not None
    factories = ("controller", "controllers", "scenario")
    assert not module_fault(found.parents[1], package, file, factories, installed=True)
