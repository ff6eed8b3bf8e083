"""Worlds that a document imports: read in a process of their own, kept by what they are made of, named in it."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from flows.cli.shell import app
from flows.pipeline import world_imports
from flows.pipeline.references import resolve_references
from flows.pipeline.world_imports import (
    ImportedWorld,
    import_lines,
    import_world,
    import_worlds,
    imported_lines,
    keep_world,
    sources_read_once,
    unresolved_lines,
)
from specs.data.world import ImportFinding, MapAgreement, Route, Start, World
from specs.errors import DocumentError, LaunchRefused
from specs.pipeline.document import PipelineSpec
from specs.pipeline.world_sections import WorldImport
from tasks.storage.base.store import Store
from tasks.storage.worlds import encode_world, world_bytes
from tasks.worlds.importer.import_process import import_source
from tasks.worlds.importer.source_scene import ImportAnswer
from tests.factories.ros_maps import write_map

ROWS = ("#" * 40, *("#" + "." * 38 + "#",) * 40, "#" * 40)


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reads sources here, so that no test waits for a process."""
    monkeypatch.setattr(world_imports, "_read_apart", lambda asked, _path, _folders: import_source(asked))


def entry(name: str = "hall", **more: object) -> WorldImport:
    return WorldImport.model_validate({"name": name, "source": "map.yaml", **more})


def document(*worlds: dict[str, object], **sections: object) -> PipelineSpec:
    export = {"outputLocation": {"s3Bucket": "own-worlds"}, "formats": ["map"]}
    return PipelineSpec.model_validate({"name": "own", "worlds": worlds, "worldExport": export, **sections})


def test_a_source_is_read_in_a_process_of_its_own(tmp_path: Path) -> None:
    write_map(tmp_path, ROWS)
    imported = import_world(entry(), tmp_path)
    expected = import_source(entry(source=str(tmp_path / "map.yaml"))).world
    assert encode_world(imported.world).decode() == expected
    assert imported.reference == f"{imported.world.generation}/hall"


@pytest.mark.usefixtures("in_process")
def test_importing_again_does_nothing(tmp_path: Path, file_store: Store) -> None:
    write_map(tmp_path, ROWS)
    keep_world(file_store, import_world(entry(), tmp_path))
    imported = import_world(entry(), tmp_path)
    keep_world(file_store, imported)
    assert world_bytes(file_store, imported.reference) == encode_world(imported.world)


@pytest.mark.usefixtures("in_process")
def test_a_run_does_not_read_again_what_its_trial_has_read(tmp_path: Path) -> None:
    write_map(tmp_path, ROWS)
    with sources_read_once():
        tried = import_worlds(entry(), tmp_path)
        (tmp_path / "map.yaml").unlink()
        assert import_worlds(entry(), tmp_path) is tried
    with pytest.raises(DocumentError, match="a file; there is none"):
        import_worlds(entry(), tmp_path)


def test_files_of_worlds_that_are_not_there_are_told_without_a_store(tmp_path: Path) -> None:
    file = tmp_path / "document.json"
    worlds: list[dict[str, object]] = [
        {"name": "a", "source": "no.yaml"},
        {"name": "b", "source": "no.world", "models": ["gone"]},
    ]
    file.write_text(document(*worlds).model_dump_json(exclude_none=True))
    found = CliRunner().invoke(app, ["validate", str(file)])
    assert isinstance(found.exception, DocumentError)
    places = [fault.path for fault in found.exception.faults]
    assert places == ["worlds[0].source", "worlds[1].source", "worlds[1].models[0]"]


@pytest.mark.usefixtures("in_process")
def test_another_world_in_its_place_is_refused(tmp_path: Path, file_store: Store) -> None:
    write_map(tmp_path, ROWS)
    imported = import_world(entry(), tmp_path)
    other = imported.world.model_copy(update={"ceiling_height_m": 9.0})
    keep_world(file_store, ImportedWorld("hall", other))
    with pytest.raises(DocumentError, match=r"nothing else at .*/hall\.json; delete what is there"):
        keep_world(file_store, imported, "worlds[0]")


@pytest.mark.usefixtures("in_process")
def test_faults_of_all_sources_are_told_where_the_document_names_them(tmp_path: Path, file_store: Store) -> None:
    write_map(tmp_path, ROWS, resolution=-1, mode="none")
    gone: dict[str, object] = {"name": "dock", "source": "dock.world", "models": ["nowhere"]}
    spec = document({"name": "hall", "source": "map.yaml"}, gone)
    with pytest.raises(DocumentError) as caught:
        resolve_references(spec, file_store, tmp_path)
    assert [(fault.path, fault.value) for fault in caught.value.faults] == [
        ("worlds[0].source", "map.yaml: resolution: -1"),
        ("worlds[0].source", "map.yaml: mode: 'none'"),
        ("worlds[1].source", "'dock.world'"),
        ("worlds[1].models[0]", "'nowhere'"),
    ]


@pytest.mark.usefixtures("in_process")
def test_a_document_is_another_one_when_its_source_is(tmp_path: Path, file_store: Store) -> None:
    spec = document({"name": "hall", "source": "map.yaml"})
    write_map(tmp_path, ROWS)
    first = resolve_references(spec, file_store, tmp_path)
    again = resolve_references(spec, file_store, tmp_path)
    write_map(tmp_path, ROWS[1:])
    other = resolve_references(spec, file_store, tmp_path)
    assert first.pins() == again.pins() != other.pins()
    assert first.pins()["worlds"] == first.imported_digests()


@pytest.mark.usefixtures("in_process")
def test_a_name_stands_for_the_imported_world(tmp_path: Path, file_store: Store) -> None:
    write_map(tmp_path, ROWS)
    config = {"application": "delivery", "launchConfig": {"packageName": "delivery", "launchFile": "rooms"}}
    request = {
        "maxJobDurationInSeconds": 60,
        "robotApplications": [{**config, "application": "courier"}],
        "simulationApplications": [{**config, "worldConfigs": [{"world": "hall"}]}],
    }
    batch = {"createSimulationJobRequests": [request], "matrix": {"worlds": ["hall", "elsewhere/world-1-1"]}}
    spec = document({"name": "hall", "source": "map.yaml"}, simulationBatch=batch)
    (imported,) = [import_world(each, tmp_path) for each in spec.worlds or ()]
    resolved = resolve_references(document({"name": "hall", "source": "map.yaml"}), file_store, tmp_path)
    placed = resolved.placed(spec)
    assert placed.simulationBatch is not None
    assert placed.simulationBatch.matrix.worlds == (imported.reference, "elsewhere/world-1-1")
    scenarios = placed.simulationBatch.createSimulationJobRequests[0].simulationApplications or ()
    configs = [config for scenario in scenarios for config in scenario.worldConfigs or ()]
    assert [each.world for each in configs] == [imported.reference]


@pytest.mark.usefixtures("in_process")
def test_all_worlds_may_be_imported_ones_alone(tmp_path: Path, file_store: Store) -> None:
    write_map(tmp_path, ROWS)
    request: dict[str, object] = {"maxJobDurationInSeconds": 60}
    for kind, name, launch in (("robot", "courier", "go_to_goal"), ("simulation", "delivery", "rooms")):
        config = {"application": name, "launchConfig": {"packageName": name, "launchFile": launch}}
        request[f"{kind}Applications"] = [config]
    batch = {"createSimulationJobRequests": [request], "matrix": {"worlds": "all"}}
    found = resolve_references(
        document({"name": "hall", "source": "map.yaml"}, simulationBatch=batch), file_store, tmp_path
    )
    assert found.batch is not None


@pytest.mark.parametrize("said", [LaunchRefused("it takes longer than 900 s"), "no answer"])
def test_a_process_that_comes_to_no_answer_is_a_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: LaunchRefused | str
) -> None:
    write_map(tmp_path, ROWS)

    def answer(*_: object) -> str:
        if isinstance(said, LaunchRefused):
            raise said
        return said

    monkeypatch.setattr(world_imports, "run_launch_program", answer)
    with pytest.raises(
        DocumentError, match="a world that is read in 900 s with 4 GB of memory; the process that reads"
    ):
        import_world(entry(), tmp_path)


def test_a_source_that_takes_too_much_memory_is_a_fault(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def read(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr("tasks.worlds.importer.import_process.read_map", read)
    answer = import_source(entry(source=str(write_map(tmp_path))))
    assert answer == ImportAnswer(faults=answer.faults)
    assert str(answer.faults[0]) == "size: more than 4 GB of memory: a smaller world"


@pytest.fixture
def world(tmp_path: Path, in_process: None) -> World:
    """Returns an imported world of which much is said."""
    write_map(tmp_path, ROWS)
    world = import_world(entry(start=[2.0, 3.0]), tmp_path).world
    assert world.report is not None
    findings = [ImportFinding(subject=f"chair_{n}", became="approximated", why="a mesh", off_m=0.01) for n in range(15)]
    findings.append(ImportFinding(subject="model://crane", became="unresolved", why="looked for in models"))
    agreement = MapAgreement(map="map.yaml", height_m=0.13, within_5cm=0.971, mean_m=0.008, free_iou=0.993)
    report = world.report.model_copy(update={"findings": tuple(findings), "agreements": (agreement,)})
    return world.model_copy(update={"report": report})


def test_the_report_says_what_became_of_a_source(world: World) -> None:
    lines = list(import_lines(world))
    assert lines[0].startswith(
        "hall from map.yaml: 4 solids, 160 of 160 parts exact, 15 approximated, 1 unresolved, a "
    )
    assert lines[1].startswith("  start [2, 3, 0] (as asked), ")
    assert lines[2] == (
        "  agrees with map.yaml, best at 0.13 m: 97.1 % of its border within 5 cm, 0.8 cm off in the mean, "
        "99.3 % of the free floor the same"
    )
    assert lines[3] == "  approximated chair_0: a mesh, off by at most 1.0 cm"
    assert lines[-2] == "  ... and 3 more approximated; the world's document has them in its report"
    assert lines[-1] == "  unresolved model://crane: looked for in models"


def test_routes_are_told(world: World) -> None:
    routes = (Route(name="tour", points_m=((1.0, 2.0), (3.0, 4.0))), Route(name="dock", points_m=((1.0, 2.0),)))
    assert "  routes tour (2), dock (1)" in import_lines(world.model_copy(update={"routes": routes}))


def test_a_file_of_routes_that_is_not_there_is_named(tmp_path: Path) -> None:
    write_map(tmp_path, ROWS)
    with pytest.raises(DocumentError) as caught:
        import_world(entry(routes=["tour.yaml"]), tmp_path)
    assert [fault.path for fault in caught.value.faults] == ["routes[0]"]


def test_a_map_in_another_frame_is_told(world: World) -> None:
    assert world.report is not None
    (agreement,) = world.report.agreements
    far = agreement.model_copy(update={"within_5cm": 0.2})
    report = world.report.model_copy(update={"agreements": (far,)})
    line = list(import_lines(world.model_copy(update={"report": report})))[2]
    assert line.startswith("  does not agree with map.yaml, best at 0.13 m: 20.0 % of its border")
    assert line.endswith("; is it of this place?")


def test_a_map_that_had_to_be_moved_is_told_by_how_much(world: World) -> None:
    assert world.report is not None
    (agreement,) = world.report.agreements
    moved = agreement.model_copy(update={"moved": Start(x_m=0.2, y_m=-1.5, yaw_rad=1.57)})
    report = world.report.model_copy(update={"agreements": (moved,)})
    line = list(import_lines(world.model_copy(update={"report": report})))[2]
    assert line.startswith(
        "  agrees with map.yaml, moved by 0.2, -1.5 m and turned by 1.57 rad, best at 0.13 m: 97.1 %"
    )


def test_what_a_world_lacks_is_an_alarm(world: World) -> None:
    assert list(unresolved_lines(world)) == ["World hall lacks model://crane: looked for in models"]


@pytest.mark.usefixtures("in_process")
def test_variants_are_worlds_of_one_generation_and_told_of_together(tmp_path: Path, file_store: Store) -> None:
    write_map(tmp_path, ROWS)
    hall: dict[str, object] = {"name": "hall", "source": "map.yaml", "variants": 3, "seed": 7}
    found = resolve_references(document(hall), file_store, tmp_path)
    worlds = [each.world for each in found.imported]
    assert [world.name for world in worlds] == ["hall-1", "hall-2", "hall-3"]
    assert len({world.generation for world in worlds}) == 1
    assert worlds[0].generation.startswith("variants-")
    assert all(world_bytes(file_store, each.reference) == encode_world(each.world) for each in found.imported)
    (first, *_) = imported_lines(found.imported_by_name())
    assert first.startswith("hall from map.yaml: 3 variants, 4 to 4 solids, ")
    assert "made for a robot of 0.25 m radius; one of up to" in first


@pytest.mark.usefixtures("in_process")
def test_variants_that_no_robot_gets_about_in_are_a_fault_of_the_document(tmp_path: Path, file_store: Store) -> None:
    write_map(tmp_path, ROWS)
    hall: dict[str, object] = {"name": "hall", "source": "map.yaml", "variants": 2, "robotRadius": 1.0}
    with pytest.raises(DocumentError, match=r"worlds\[0\]\.variants: 2: hall: a robot of 1 m radius "):
        resolve_references(document(hall), file_store, tmp_path)
