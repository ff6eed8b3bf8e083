"""The commands of `simyard app`: make applications, and publish their versions."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer

from flows.cli.terminal import StoreUrl, echo
from flows.pipeline.version_retention import free_versions, limit_exceeded
from specs.errors import BundleRefused, DocumentError, LimitExceeded
from specs.field_types import Architecture
from specs.robomaker.applications import SourceConfig
from specs.robomaker.bundle import ARCHITECTURES, ApplicationKind
from tasks.applications.bucket_sources import create_application, create_version, delete_application, update_application
from tasks.applications.registry import publish_bundle as publish_folders
from tasks.documents.parse import parse
from tasks.storage.container_image import image_bundle, is_image_source
from tasks.storage.store_url import open_existing_store, open_store

app_app = typer.Typer(help="Make applications and publish their versions.", no_args_is_help=True)

_Name = Annotated[str, typer.Argument(help="The application's name.", show_default=False)]
_Kind = Annotated[Literal["robot", "simulation"], typer.Option(help="What the bundle holds.")]
_Revision = Annotated[
    str | None, typer.Option(help="Only if the application still has this revisionId, as describe tells it.")
]
_Sources = Annotated[
    list[str] | None,
    typer.Option("--source", metavar="ARCHITECTURE=s3://BUCKET/KEY", help="Where a bundle lies, a plain tar."),
]


@app_app.command("create")
def create(name: _Name, source: _Sources = None, kind: _Kind = "robot", store: StoreUrl = None) -> None:
    """Make an application without versions, and say where its bundles will lie."""
    made = create_application(open_store(store), _kind(kind), name, _sources(source or []))
    echo(f"{made.name}: revision {made.revision}")


@app_app.command("update")
def update(
    name: _Name, source: _Sources = None, kind: _Kind = "robot", revision: _Revision = None, store: StoreUrl = None
) -> None:
    """Say anew where an application's bundles lie; its versions stay as they are."""
    opened = open_existing_store(store)
    changed = update_application(opened, _kind(kind), name, _sources(source or []), revision)
    echo(f"{changed.name}: revision {changed.revision}")


@app_app.command("publish")
def publish(
    name: _Name,
    bundle: Annotated[
        str | None,
        typer.Argument(
            help="A folder with robot.xml and packages, or with a scenario; or a container image: app.tar, docker://..."
        ),
    ] = None,
    *,
    robot: Annotated[
        Path | None, typer.Option(help="Folder with robot.xml and ros.yaml, for a container image that has none.")
    ] = None,
    architecture: Annotated[
        list[str] | None,
        typer.Option(metavar="ARCHITECTURE=BUNDLE", help="A bundle for X86_64, ARM64 or ARMHF alone; once for each."),
    ] = None,
    kind: _Kind = "robot",
    revision: _Revision = None,
    store: StoreUrl = None,
) -> None:
    """Publish an application's next version; the same content keeps its number.

    Of one bundle, of one for each architecture, or else of what lies at the application's sources.
    """
    opened, own = open_store(store), _bundles(architecture or [])
    if bundle and own:
        raise _refused("--architecture", bundle, "one bundle for all architectures, or one for each")
    if bundle or own:
        folders: dict[Architecture, Path] = {each: _folder(source, robot, each) for each, source in own.items()}
        source = folders or _folder(bundle or "", robot)
        publish_one = partial(publish_folders, opened, _kind(kind), name, source, current_revision=revision)
    else:
        publish_one = partial(create_version, opened, _kind(kind), name, revision)
    try:
        version = publish_one()
    except LimitExceeded as exc:
        raise limit_exceeded(name, _kind(kind), free_versions(opened, _kind(kind), name)) from exc
    builds = [f"{build.digest} {build.architecture}" for build in version.builds] or [version.digest]
    echo(f"{version.name} version {version.number}: {', '.join(builds)}")


@app_app.command("draft")
def draft(
    bundle: Annotated[Path, typer.Argument(help="Folder of a simulation application's packages.", show_default=False)],
    package: Annotated[str, typer.Argument(help="The launch configuration's packageName.", show_default=False)],
    launch_file: Annotated[str, typer.Argument(help="Its launchFile, which starts Gazebo.", show_default=False)],
    *,
    out: Annotated[
        Path | None, typer.Option(help="Where robot.xml and ros.yaml are written to; the bundle, if left out.")
    ] = None,
    variable: Annotated[
        list[str] | None, typer.Option(metavar="NAME=VALUE", help="An environment variable; may be repeated.")
    ] = None,
) -> None:
    """Write robot.xml and ros.yaml of the robot that a launch file spawns in Gazebo, to be edited.

    Names all of its description that is not taken, and prints the entry of a document's worlds for its world.
    """
    from flows.pipeline.robot_drafts import draft_of_launch, world_entry, write_draft  # noqa: PLC0415 - loads shapely
    from tasks.ros.launch.launch_plan import LaunchSource  # noqa: PLC0415 - of this command alone

    variables = {name: value for name, _, value in (each.partition("=") for each in variable or ())}
    found = draft_of_launch(LaunchSource(bundle.resolve(), package, launch_file), variables)
    for path in write_draft(found.draft, out or bundle):
        echo(str(path))
    for finding in (*found.draft.findings, *found.gazebo.findings):
        echo(f"  {finding}", err=True)
    if entry := world_entry(found.gazebo, Path.cwd()):
        echo(f"worlds:\n  {entry}")


@app_app.command("delete")
def delete(
    name: _Name,
    version: Annotated[str | None, typer.Option(help="Only this version.")] = None,
    kind: _Kind = "robot",
    store: StoreUrl = None,
) -> None:
    """Delete an application, or a version; its number is not given again, and robots that run it run on."""
    left = delete_application(open_existing_store(store), _kind(kind), name, version)
    echo(f"{name} is deleted" if left.deleted else f"{name} version {version} is deleted; left: {left.numbers}")


def _kind(kind: Literal["robot", "simulation"]) -> "ApplicationKind":
    return "robot-application" if kind == "robot" else "simulation-application"


def _sources(given: Sequence[str]) -> "list[SourceConfig]":
    found: list[SourceConfig] = []
    for architecture, place in _pairs(given, "--source"):
        if not place.startswith("s3://"):
            raise _refused("--source", place, "s3://BUCKET/KEY")
        bucket, _, key = place.removeprefix("s3://").partition("/")
        document = {"s3Bucket": bucket, "s3Key": key, "architecture": architecture}
        found.append(parse(SourceConfig, {**document}, "--source"))
    return found


def _bundles(given: Sequence[str]) -> "dict[Architecture, str]":
    pairs = _pairs(given, "--architecture")
    if len(dict(pairs)) < len(pairs):
        raise _refused("--architecture", ", ".join(given), "each architecture once")
    return dict(pairs)


def _folder(source: str, robot: Path | None, architecture: Architecture = "X86_64") -> Path:
    """Returns the folder of a bundle; a container image's is made in the cache."""
    if not is_image_source(source, Path()):
        if robot:
            raise _refused("--robot", str(robot), f"nothing: {source} is no container image, and has its own")
        return Path(source)
    try:
        return image_bundle(source, Path(), robot, architecture)
    except BundleRefused as exc:
        raise _refused("bundle", source, f"a folder, or a container image that can be run; {exc}") from exc


def _pairs(given: Sequence[str], option: str) -> "list[tuple[Architecture, str]]":
    found: list[tuple[Architecture, str]] = []
    for text in given:
        name, _, value = text.partition("=")
        known: Architecture | None = next((each for each in ARCHITECTURES if each == name), None)
        if known is None or not value:
            raise _refused(option, text, f"{' or '.join(ARCHITECTURES)}, =, and the place of its bundle")
        found.append((known, value))
    return found


def _refused(option: str, value: str, allowed: str) -> Exception:
    return DocumentError.of(option, repr(value), allowed, source="simyard")
