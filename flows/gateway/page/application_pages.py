"""The pages of robot and simulation applications, with their versions."""

from collections.abc import Mapping
from functools import partial
from pathlib import PurePosixPath

from flows.gateway.page.stored import at_once, newest_names, step_of
from flows.gateway.page.visit import Visit, address, missing, when
from specs.errors import StoreError, StoreUnreachable
from specs.robomaker.bundle import Application, ApplicationKind, Version
from tasks.applications.versions import read_application
from tasks.gateway.page.content import Cell, Facts, Page, Table
from tasks.storage.base.keys import applications_prefix

KINDS: Mapping[str, ApplicationKind] = {"robot": "robot-application", "simulation": "simulation-application"}


def applications_page(visit: Visit) -> Page:
    """Returns the list of applications of both kinds."""
    tables = tuple(_table(visit, word, kind) for word, kind in KINDS.items())
    return Page("Applications", blocks=tables)


def application_page(visit: Visit, kind: ApplicationKind, name: str) -> Page:
    """Returns the page of an application with its versions.

    Raises:
        ResourceNotFound: There is none, or it may not be seen.
        DocumentError: The name can be no application's.
    """
    visit.require(kind, name)
    found = read_application(visit.store, kind, name)
    if found is None or found.deleted:
        raise missing(kind, name)
    rows = tuple(
        (
            Cell(str(version.number)),
            Cell(version.digest, is_code=True),
            Cell(f"{version.size_bytes:,}", is_number=True),
            Cell(_origin(version)),
            when(version.created_at_s),
        )
        for version in reversed(found.versions)
    )
    table = Table("Versions", ("Version", "Bundle", "Bytes", "From", "Made"), rows, "No version yet.")
    sources = tuple(
        ("source", Cell(f"s3://{each.s3Bucket}/{each.s3Key}", small=str(each.architecture))) for each in found.sources
    )
    facts = Facts("The application", (*sources, *visit.arn_rows(visit.arn(kind, name))))
    title = "Robot application" if kind == "robot-application" else "Simulation application"
    return Page(name, title, trail=(("Applications", "/applications"),), blocks=(table, facts))


def _table(visit: Visit, word: str, kind: ApplicationKind) -> Table:
    def name_of(key: str) -> str:
        name = PurePosixPath(key).stem
        return name if visit.may_read(visit.arn(kind, name)) else ""

    shown, steps = step_of(visit, newest_names(visit, applications_prefix(kind), name_of), "/applications")
    found = at_once(partial(_application, visit, kind), shown)
    rows = tuple(
        (
            Cell(each.name, address(kind, each.name)),
            Cell(each.numbers),
            when(each.versions[-1].created_at_s if each.versions else None),
        )
        for each in found
        if each
    )
    columns = ("Application", "Versions", "Newest from")
    return Table(f"{word.capitalize()} applications", columns, rows, "None yet.", steps=steps)


def _application(visit: Visit, kind: ApplicationKind, name: str) -> Application | None:
    try:
        found = read_application(visit.store, kind, name)
    except StoreUnreachable:
        raise
    except StoreError:  # it is damaged
        return None
    return None if found is None or found.deleted else found


def _origin(version: Version) -> str:
    if version.builds:
        return ", ".join(build.architecture for build in version.builds)
    return "Simyard" if version.shipped else "a document" if version.brought else "a folder"
