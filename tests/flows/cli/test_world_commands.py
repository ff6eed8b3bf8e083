"""Looking at worlds from the command line: files come, and what is missing is said in one line."""

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import get_args
from xml.etree import ElementTree as ET

import pytest
from typer.testing import CliRunner, Result

from flows.cli.shell import app
from flows.preview import world_preview
from specs.data.world import World
from specs.errors import DocumentError, ResourceNotFound
from specs.robomaker.world_jobs import CreateWorldGenerationJobRequest
from specs.template.body import TemplateBody
from specs.template.interior import ModelType
from tasks.documents.template_source import find_template
from tasks.export.picture.renderer import open_renderer
from tasks.render.gl_process import NO_GL
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, submit
from tasks.storage.store_url import open_store
from tasks.storage.worlds import encode_world, write_world
from tasks.worlds.floorplan.search import WorldRejected
from tasks.worlds.job.generation_job import KIND, run_generation_job
from tests.export.png_reader import SIGNATURE
from tests.factories.ros_maps import write_map
from tests.factories.worlds import apartment
from tests.repository import ROOT
from tests.servers.tools import skip_or_fail

TEMPLATE = ROOT / "examples" / "templates" / "two-rooms.json"


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs each command in a folder of its own, without GL: pictures take seconds."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("SIMYARD_STORE", raising=False)
    monkeypatch.setenv("MUJOCO_GL", "nonsense")


def world(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["world", *arguments], catch_exceptions=False)


def plans(file: Path) -> list[str]:
    """Returns the names of the worlds on a sheet."""
    root = ET.fromstring(file.read_text())  # noqa: S314 - our own document
    svg = "{http://www.w3.org/2000/svg}"
    return [found.findtext(f"{svg}title", "") for found in root.iter(f"{svg}g") if found.get("class") == "plan"]


@pytest.fixture
def job(tmp_path: Path) -> JobRecord:
    """Returns a job that made three worlds, in the default store."""
    store = open_store((tmp_path / ".simyard").as_uri())
    template = find_template(str(TEMPLATE), store, tmp_path)
    counts = {"floorplanCount": 3, "interiorCountPerFloorplan": 1}
    reference = "arn:simyard:world-template:0123456789ab:any"
    request = CreateWorldGenerationJobRequest.model_validate({"template": reference, "worldCount": counts})
    return run_generation_job(store, request, template, seed=3, token="t", progress=lambda *_: None)  # noqa: S106


def test_a_preview_draws_the_plan_where_one_says_and_says_where():
    done = world("preview", str(TEMPLATE), "--seed", "4", "--output", "plan.svg")
    assert done.stdout.split() == ["plan.svg"]
    assert "seed 4" in Path("plan.svg").read_text()


def test_without_gl_a_preview_says_in_one_line_how_to_get_the_picture():
    done = world("preview", str(TEMPLATE))
    assert done.stderr == f"{NO_GL}\n"
    assert "libosmesa6" in done.stderr
    assert list(Path().glob("world-preview.*")) == [Path("world-preview.svg")]


@pytest.mark.long
def test_where_gl_is_there_the_picture_lies_beside_the_plan(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("MUJOCO_GL")
    for side in ("_WIDTH", "_HEIGHT"):
        monkeypatch.setattr(f"flows.cli.world_commands.{side}", 64)
    with open_renderer(16, 16, 1) as render:
        if render is None:
            skip_or_fail("neither EGL nor OSMesa works here: apt-get install libosmesa6")
    done = world("preview", str(TEMPLATE), "--output", "plan.svg")
    assert done.stdout.split() == ["plan.svg", "plan.png"]
    assert Path("plan.png").read_bytes().startswith(SIGNATURE)


@pytest.mark.parametrize(
    ("option", "value", "argument"),
    [
        ("--seed", "9", ("seed", 9)),
        ("--floorplan", "3", ("floorplan_index", 3)),
        ("--interior", "2", ("interior_index", 2)),
        ("--robot-radius", "0.3", ("robot_radius_m", 0.3)),
    ],
)
def test_each_option_decides_about_the_world(
    option: str, value: str, argument: tuple[str, float], monkeypatch: pytest.MonkeyPatch
):
    asked: dict[str, object] = {}

    def recorded(template: TemplateBody, **arguments: object) -> World:
        del template
        asked.update(arguments)
        return apartment()

    monkeypatch.setattr(world_preview, "generate_world", recorded)
    world("preview", str(TEMPLATE), option, value)
    usual = {"seed": 0, "generation": "preview", "floorplan_index": 1, "interior_index": 1, "robot_radius_m": 0.25}
    assert asked == {**usual, argument[0]: argument[1]}


def test_interiors_share_their_floor_plan():
    for interior in ("1", "2"):
        world("preview", str(TEMPLATE), "--interior", interior, "--output", f"{interior}.svg")
    first, second = (Path(f"{interior}.svg").read_text() for interior in ("1", "2"))
    assert first.split('class="dimension"')[1].split("</g>")[0] == second.split('class="dimension"')[1].split("</g>")[0]


def test_a_png_as_output_is_refused_for_the_picture_would_overwrite_the_plan():
    with pytest.raises(DocumentError, match="an SVG file"):
        world("preview", str(TEMPLATE), "--output", "plan.png")
    assert list(Path().glob("plan*")) == []


def test_a_sheet_of_a_template_shows_its_first_floor_plans():
    done = world("sheet", str(TEMPLATE), "--count", "3", "--seed", "2", "--output", "sheet.svg")
    assert done.stdout.split() == ["sheet.svg"]
    assert plans(Path("sheet.svg")) == ["world-1-1", "world-2-1", "world-3-1"]


def test_a_sheet_of_a_job_shows_its_worlds_and_tells_how_many_there_are(job: JobRecord):
    for reference in (job.id, job.arn):
        world("sheet", reference, "--count", "2", "--output", "sheet.svg")
        assert plans(Path("sheet.svg")) == ["world-1-1", "world-2-1"]
        assert "the first 2 of 3 worlds" in Path("sheet.svg").read_text()


def test_a_sheet_writes_no_picture_unless_asked_for_one():
    assert world("sheet", str(TEMPLATE), "--count", "1").stderr == ""
    assert world("sheet", str(TEMPLATE), "--count", "1", "--png").stderr == f"{NO_GL}\n"


def test_a_job_that_is_not_there_is_refused():
    with pytest.raises(ResourceNotFound, match="wgj-0000000000000000"):
        world("sheet", "wgj-0000000000000000")


def test_a_job_that_made_nothing_is_refused(file_store: Store):
    empty = submit(file_store, KIND, {}, "t")
    with pytest.raises(DocumentError, match="a job that has made worlds"):
        world("sheet", empty.id, "--store", file_store.url)


def test_worlds_that_cannot_be_made_are_named_and_the_others_drawn(monkeypatch: pytest.MonkeyPatch):
    def second_fails(template: TemplateBody, *, floorplan_index: int, **_: object) -> World:
        del template
        if floorplan_index == 2:
            raise WorldRejected("InternalServiceError", "no luck")
        return apartment(name=f"world-{floorplan_index}-1")

    monkeypatch.setattr(world_preview, "generate_world", second_fails)
    done = world("sheet", str(TEMPLATE), "--count", "3", "--output", "sheet.svg")
    assert done.stderr == "InternalServiceError: no luck\n"
    assert plans(Path("sheet.svg")) == ["world-1-1", "world-3-1"]


def test_a_template_that_gives_no_world_is_told_why(monkeypatch: pytest.MonkeyPatch):
    def fails(template: TemplateBody, **_: object) -> World:
        raise WorldRejected("InvalidInput", "too small")

    monkeypatch.setattr(world_preview, "generate_world", fails)
    with pytest.raises(WorldRejected, match="too small"):
        world("sheet", str(TEMPLATE), "--count", "2")


@pytest.mark.long
def test_looking_at_worlds_loads_neither_jax_nor_prefect_nor_mujoco():
    check = (
        "import sys; from typer.testing import CliRunner; from flows.cli.shell import app; "
        f"done = CliRunner().invoke(app, ['world', 'preview', {json.dumps(str(TEMPLATE))}]); "
        "assert done.exit_code == 0, done.output; "
        "sys.exit(str(sorted({'jax', 'prefect', 'mujoco'} & set(sys.modules))))"
    )
    done = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, check=False)
    assert done.stderr.strip().endswith("[]")


def test_a_starter_is_a_template_as_it_stands_and_says_what_to_do_next():
    done = world("template", "--rooms", "bedroom,Kitchen", "--output", "homes/mine.yaml")
    assert done.stdout == "homes/mine.yaml\n"
    assert "simyard world preview homes/mine.yaml" in done.stderr
    body = find_template("homes/mine.yaml", open_store(Path("store").resolve().as_uri()), Path())
    assert [room.Name for room in body.Buildings[0].Floors[0].Floorplan.Rooms] == ["Bedroom", "Kitchen"]
    assert world("preview", "homes/mine.yaml").exit_code == 0


def test_a_starter_never_overwrites_a_file():
    Path("template.yaml").write_text("mine")
    with pytest.raises(DocumentError, match=r"template\.yaml is there already"):
        world("template")
    assert Path("template.yaml").read_text() == "mine"


def test_all_that_is_wrong_with_the_wish_for_a_starter_is_told_at_once():
    with pytest.raises(DocumentError) as caught:
        world("template", "--rooms", "bedrom,,attic", "--version", "3", "--output", "mine.txt")
    told = [str(fault) for fault in caught.value.faults]
    assert [line.split(":")[0] for line in told] == ["--rooms", "--rooms", "--rooms", "--version", "--output"]
    assert 'did you mean "bedroom"?' in told[0]
    assert list(Path().iterdir()) == []


def test_the_kinds_of_furniture_are_listed_with_their_sizes():
    rows = world("furniture").stdout.splitlines()
    assert [row.split()[0] for row in rows] == ["kind", *get_args(ModelType)]
    assert "1.6-2.7" in next(row for row in rows if row.startswith("Sofas"))


def test_each_kind_of_furniture_gets_a_picture_and_programs_get_json():
    done = world("furniture", "--json", "--pictures", "kinds")
    kinds = [json.loads(line) for line in done.stdout.splitlines()]
    assert sorted(f"{each['kind']}.svg" for each in kinds) == sorted(file.name for file in Path("kinds").iterdir())
    assert all(each["width_m"][0] <= each["width_m"][1] for each in kinds)


def test_pictures_of_furniture_that_cannot_be_written_are_refused():
    Path("kinds").write_text("a file")
    with pytest.raises(DocumentError, match="--pictures: kinds"):
        world("furniture", "--pictures", "kinds")


def test_a_starter_that_cannot_be_written_says_why():
    Path("homes").write_text("a file")
    with pytest.raises(DocumentError, match="cannot be written"):
        world("template", "--output", "homes/mine.yaml")


def test_import_prints_what_documents_name_a_world_by_and_tells_of_its_source(tmp_path: Path) -> None:
    write_map(tmp_path, ("#" * 40, *("#" + "." * 38 + "#",) * 40, "#" * 40))
    result = world("import", "map.yaml", "--name", "hall", "--start", "2,3", "--wall-height", "2.5")
    assert result.exit_code == 0, result.output
    reference = result.stdout.strip()
    assert re.fullmatch(r"import-[0-9a-f]{16}/hall", reference)
    assert "hall from map.yaml: 4 solids, 160 of 160 parts exact" in result.stderr
    picture = tmp_path / ".simyard" / "worlds" / reference.partition("/")[0] / "contact-sheet.svg"
    assert f"picture {picture.as_uri()}" in result.stderr
    assert picture.is_file()
    told = result.stderr.split("  picture")[0]
    assert world("show", reference).stdout == told
    assert "drawn.svg" in world("preview", reference, "--output", "drawn.svg").stdout
    world("sheet", reference.partition("/")[0], "--output", "sheet.svg")
    assert plans(Path("sheet.svg")) == ["hall"]


def test_import_tells_all_faults_of_its_options_at_once(tmp_path: Path) -> None:
    write_map(tmp_path)
    with pytest.raises(DocumentError) as caught:
        world("import", "map.yaml", "--unit", "cm", "--wall-height", "-1")
    assert [fault.path for fault in caught.value.faults] == ["--wall-height", "--unit"]
    with pytest.raises(DocumentError, match="--start: 'here': x,y or x,y,yaw"):
        world("import", "map.yaml", "--start", "here")


def test_show_tells_what_a_generated_world_is(tmp_path: Path) -> None:
    store = open_store((tmp_path / ".simyard").as_uri())
    write_world(store, "hand/world-1", encode_world(apartment(generation="hand", name="world-1")))
    lines = world("show", "hand/world-1").stdout.splitlines()
    assert lines[0].startswith("world-1 by ")
    assert "gets into every room" in lines[1]


@pytest.mark.parametrize("command", ["preview", "add"])
def test_a_building_where_something_else_is_meant_names_import(tmp_path: Path, command: str) -> None:
    path = write_map(tmp_path)
    with pytest.raises(DocumentError, match=f"`simyard world import .*{path.name}`"):
        world(command, "map.yaml")


def test_a_gazebo_world_where_a_template_is_meant_names_import(tmp_path: Path) -> None:
    (tmp_path / "hall.world").write_text("<sdf version='1.6'/>")
    with pytest.raises(DocumentError, match=r"a building, and no document: `simyard world import .*hall\.world`"):
        world("preview", "hall.world")
