"""The records of the formats are those that a document may name, in the order of the zip."""

import subprocess
import sys
import tomllib

from specs.pipeline.world_sections import FORMATS
from tasks.export.format.formats import EXPORT_FORMATS
from tests.repository import ROOT


def test_every_format_that_a_document_may_name_has_a_record_and_no_other() -> None:
    assert tuple(EXPORT_FORMATS) == FORMATS
    assert all(each.name == name for name, each in EXPORT_FORMATS.items())


def test_what_a_format_needs_is_an_extra_of_its_name() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert all(name in extras for name, each in EXPORT_FORMATS.items() if each.needs)


def test_to_look_what_is_installed_imports_no_writer() -> None:
    code = (
        "import sys\nfrom specs.pipeline.world_sections import FORMATS\n"
        "from tasks.export.format.formats import require_writable\nrequire_writable(FORMATS, 'test')\n"
        "print([name for name in ('trimesh', 'PIL', 'pxr', 'mujoco', 'scipy') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
