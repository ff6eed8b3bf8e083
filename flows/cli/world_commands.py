"""The commands of `simyard world`: template, furniture, preview, sheet, add, import, show."""

from pathlib import Path
from typing import Annotated

import typer

from flows.cli.terminal import StoreUrl, TerminalConsole, echo, echo_json, json_lines, show_rows
from flows.pipeline.world_imports import import_lines, import_world, keep_world
from flows.preview.world_preview import (
    WorldRequest,
    find_world,
    furniture_kinds,
    furniture_rows,
    make_world,
    read_import_options,
    select_worlds,
    template_hints,
    world_lines,
    write_drawing,
    write_furniture_pictures,
    write_picture,
    write_starter,
)
from specs.arn import parse_reference
from specs.data.world import ROBOT_RADIUS_M
from tasks.documents.template_source import find_template
from tasks.export.drawing.floor_plan import floor_plan_svg
from tasks.export.picture.contact_sheet import contact_sheet_svg
from tasks.export.picture.renderer import render_png, render_sheet_png
from tasks.export.step import draw_imported
from tasks.render.gl_process import NO_GL
from tasks.storage.base.keys import contact_sheet_key
from tasks.storage.store_url import open_existing_store, open_store
from tasks.storage.worlds import read_world
from tasks.worlds.job.stored_worlds import add_world

world_app = typer.Typer(help="Look at worlds.", no_args_is_help=True)

_WIDTH, _HEIGHT = 1280, 960
_Seed = Annotated[int, typer.Option(min=0, help="The same seed draws the same world.")]
_RobotRadius = Annotated[
    float, typer.Option(min=0.05, max=0.6, help="Radius (m) of the robot that every room shall be reachable for.")
]


@world_app.command("template")
def template(
    *,
    rooms: Annotated[
        str,
        typer.Option(
            help="From 1 to 6 of bedroom, bathroom, living, dining, kitchen, hallway and closet, with commas."
        ),
    ] = "hallway,living,kitchen,bedroom,bathroom",
    version: Annotated[str, typer.Option(help="1, or 2, which has doors.")] = "2",
    output: Annotated[
        Path, typer.Option(help="The file to write: YAML with comments, or .json. It must not be there yet.")
    ] = Path("template.yaml"),
) -> None:
    """Write a template to begin with: complete, commented, and valid as it stands."""
    write_starter(output, rooms, version)
    echo(str(output))
    for line in template_hints(output):
        echo(line, err=True)


@world_app.command("furniture")
def furniture(
    *,
    pictures: Annotated[
        Path | None, typer.Option(help="A folder for a picture of each kind (SVG), all at one scale.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document a line.")] = False,
) -> None:
    """List the kinds of furniture that a template may wish: sizes (m), floor kept free, rooms that have them anyway."""
    if as_json:
        for line in json_lines(furniture_kinds()):
            echo_json(line)
    else:
        show_rows(furniture_rows(), TerminalConsole())
    if pictures:
        files = write_furniture_pictures(pictures)
        echo(f"{len(files)} pictures in {pictures}", err=True)


@world_app.command("preview")
def preview(
    template: Annotated[
        str, typer.Argument(help="A template: path, ARN, or name; or a world of the store.", show_default=False)
    ],
    *,
    output: Annotated[Path, typer.Option(help="The SVG to write; a PNG goes beside it.")] = Path("world-preview.svg"),
    seed: _Seed = 0,
    floorplan: Annotated[int, typer.Option(min=1, help="Which floor plan.")] = 1,
    interior: Annotated[int, typer.Option(min=1, help="Which interior of the floor plan.")] = 1,
    robot_radius: _RobotRadius = ROBOT_RADIUS_M,
    store: StoreUrl = None,
) -> None:
    """Draw a world of a template, or of the store: its floor plan and, where a GL is there, a picture in 3-D."""
    opened = open_store(store)
    world = find_world(template, opened)
    if world is None:
        body = find_template(template, opened, Path.cwd())
        world = make_world(body, WorldRequest(seed, robot_radius), floorplan, interior)
    write_drawing(output, floor_plan_svg(world))
    echo(str(output))
    _picture(output, render_png(world, _WIDTH, _HEIGHT))


@world_app.command("sheet")
def sheet(
    worlds: Annotated[
        str,
        typer.Argument(
            help="A template (path, ARN or name), a generation job (ARN or id), or an import (import-*, variants-*).",
            show_default=False,
        ),
    ],
    *,
    output: Annotated[Path, typer.Option(help="The SVG to write.")] = Path("worlds-sheet.svg"),
    count: Annotated[int, typer.Option(min=1, max=60, help="How many worlds to show.")] = 24,
    seed: _Seed = 0,
    robot_radius: _RobotRadius = ROBOT_RADIUS_M,
    png: Annotated[bool, typer.Option("--png", help="Write a sheet of pictures in 3-D beside it.")] = False,
    store: StoreUrl = None,
) -> None:
    """Draw many worlds on one sheet: the first floor plans of a template, or the worlds of a job or an import."""
    chosen = select_worlds(worlds, open_store(store), Path.cwd(), count, WorldRequest(seed, robot_radius))
    for reason in chosen.rejected:
        echo(reason, err=True)
    write_drawing(output, contact_sheet_svg(chosen.worlds, title=chosen.title, total=chosen.total))
    echo(str(output))
    if png:
        _picture(output, render_sheet_png(chosen.worlds))


@world_app.command("add")
def add(
    file: Annotated[Path, typer.Argument(help="A world's document, such as simyard shrink's.", show_default=False)],
    store: StoreUrl = None,
) -> None:
    """Put a world into the store, if what its certificate says is so; prints what documents name it by."""
    echo(add_world(open_store(store), file))


@world_app.command("import")
def import_(
    source: Annotated[
        Path,
        typer.Argument(help="A map of ROS (.yaml), a Gazebo world, a scene of MuJoCo, a mesh.", show_default=False),
    ],
    *,
    name: Annotated[str, typer.Option(help="The world's name; the file's, if left out.", show_default=False)] = "",
    start: Annotated[
        str, typer.Option(help="Where the robot starts: x,y or x,y,yaw; found, if left out.", show_default=False)
    ] = "",
    models: Annotated[
        list[Path] | None, typer.Option(help="A folder that model:// and package:// lead to; may be repeated.")
    ] = None,
    wall_height: Annotated[float | None, typer.Option(help="How high (m) stands what a map shows; 2.")] = None,
    unit: Annotated[str | None, typer.Option(help="Of a mesh: m, cm, mm, in or ft.")] = None,
    routes: Annotated[
        list[Path] | None,
        typer.Option(help="A file of routes, places or zones, such as Nav2's waypoints; may be repeated."),
    ] = None,
    store: StoreUrl = None,
) -> None:
    """Import a building of your own; prints what documents name it by, and what became of its parts."""
    opened = open_store(store)
    asked = read_import_options(
        {
            "name": name or None,
            "source": str(source),
            "start": start or None,
            "models": [str(each) for each in models or ()] or None,
            "wallHeight": wall_height,
            "unit": unit,
            "routes": [str(each) for each in routes or ()] or None,
        }
    )
    imported = import_world(asked, Path.cwd())
    keep_world(opened, imported)
    draw_imported(opened.url, [imported.reference])
    picture = f"{opened.url}/{contact_sheet_key(imported.world.generation)}"
    echo(imported.reference)
    for line in (*import_lines(imported.world), f"  picture {picture}"):
        echo(line, err=True)


@world_app.command("show")
def show(
    world: Annotated[
        str, typer.Argument(help="A world of the store: its ARN, or <generation>/<world>.", show_default=False)
    ],
    store: StoreUrl = None,
) -> None:
    """Say what a world is: what became of an imported one's parts, or which wishes a generated one does not meet."""
    opened = open_existing_store(store)
    for line in world_lines(read_world(opened, parse_reference(world).path, "simyard world show")):
        echo(line)


def _picture(output: Path, png: bytes | None) -> None:
    """Writes the picture beside its drawing, or says what is missing for it."""
    if png is None:
        echo(NO_GL, err=True)
    else:
        echo(str(write_picture(output, png)))
