"""Each recipe of CONTRIBUTING.md, "How to add ...", is followed on a copy of the tree, and what was added works."""

import shutil
from pathlib import Path

import pytest

from tests.docs.recipes.tree_copy import TreeCopy
from tests.repository import ROOT

HEADINGS = [
    "a furniture type",
    "a results column",
    "a gate rule",
    "an outcome reason",
    "a job kind",
    "an engine",
    "a failure code",
    "a sensor",
    "an export format",
]


@pytest.fixture
def tree(tmp_path: Path) -> TreeCopy:
    """A copy of the source to change."""
    return TreeCopy(tmp_path)


def simulated(tree: TreeCopy, engine: str) -> str:
    """The status of an episode of the test's robot, whose bundle may have been changed, on an engine of the copy."""
    return tree.run(
        "from pathlib import Path\n"
        "from tasks.simulate.devices import prepare_devices; prepare_devices()\n"
        "from tasks.simulate.chunk.chunk_simulation import simulate_episodes\n"
        "from tasks.simulate.plan.chunks import plan_chunks\n"
        "from tests.factories.simulations import DRIFT, FAULTY, BUNDLES, pen, pushing\n"
        "(chunk,) = plan_chunks([pushing(0, world='w', duration_s=0.5)], 1)\n"
        "folders = {FAULTY: Path('bundle'), DRIFT: BUNDLES / 'drift'}\n"
        f"options = dict(lanes=1, engine={engine!r}, should_stop=lambda: False)\n"
        "(row,) = simulate_episodes(chunk, {'w': pen(4.0, 1)}, folders, **options)\n"
        "print(row.status, row.failure_reason)"
    ).strip()


def _sections() -> dict[str, list[str]]:
    text = (ROOT / "CONTRIBUTING.md").read_text()
    parts = text.split("\n## How to add ")[1:]
    return {part.splitlines()[0]: part.split("\n## ")[0].splitlines()[1:] for part in parts}


def test_each_thing_that_people_add_has_a_recipe_of_at_most_five_steps():
    sections = _sections()
    assert sorted(sections) == sorted(HEADINGS)
    for thing, lines in sections.items():
        assert 1 <= len([line for line in lines if line[:1].isdigit()]) <= 5, thing


@pytest.mark.long
def test_a_furniture_type_is_a_name_and_a_record(tree: TreeCopy):
    tree.replace("specs/template/interior.py", '    "Baths",\n', '    "Baths",\n    "TowelHeaters",\n')
    tree.add_before(
        "tasks/worlds/furniture/bathroom.py",
        '    FurnitureType(\n        "Showers",',
        '    FurnitureType(\n        "TowelHeaters",\n        washing_machine,\n'
        "        one_size((0.6, 0.6), (0.6, 0.6), (0.85, 0.85)),\n    ),\n",
    )
    made = tree.run(
        "from specs.template.body import template_body\n"
        "from tasks.export.drawing.floor_plan import floor_plan_svg\n"
        "from tasks.worlds.generate import generate_world\n"
        "room = {'Type': 'Bathroom', 'Name': 'bath', 'DesiredShape': {'Area': 12, 'AspectRatio': {'x': 1, 'y': 1}}}\n"
        "wish = {'Name': 'set', 'TargetSet': {'RoomNames': ['bath']}, 'DesiredSpatialDensity': 'Moderate', "
        "'SampleSet': {'ModelTypes': ['TowelHeaters']}}\n"
        "interior = {'Furniture': {'FurnitureArrangements': [wish]}}\n"
        "floor = {'Floorplan': {'Rooms': [room]}, 'Interior': interior}\n"
        "body = template_body({'Version': '2', 'Buildings': [{'Floors': [floor]}]})\n"
        "world = generate_world(body, seed=1, generation='g', floorplan_index=1, interior_index=1)\n"
        "floor_plan_svg(world)\n"
        "print(*{piece.model_type for piece in world.furniture})"
    )
    assert made.split() == ["TowelHeaters"]
    tree.followed("a furniture type")


@pytest.mark.long
def test_a_results_column_is_one_record(tree: TreeCopy):
    tree.add_before(
        "specs/data/result_columns.py",
        '    _measured("path_length_m",',
        '    Column("half_path_m", "double", "m", "Half of it.", lambda each: each.results.cells["path_length_m"]'
        '._replace(numbers=each.results.numbers("path_length_m") / 2), measure=True),\n',
    )
    made = tree.run(
        "from tasks.results.tables.episode_tables import results_table\n"
        "from specs.pipeline.gate_section import Gate\n"
        "from tests.factories.episodes import passed, request\n"
        "table = results_table('simb-1', [request(0)], [passed(0)])\n"
        "Gate.model_validate({'quantiles': [{'column': 'half_path_m', 'quantile': 0.5, 'atMost': 9.0}]})\n"
        "print(table.column('half_path_m').to_pylist(), table.column('path_length_m').to_pylist())"
    )
    halves, whole = made.strip().split("] [")
    assert 2 * float(halves.strip("[")) == float(whole.strip("]"))
    tree.followed("a results column")


@pytest.mark.long
def test_an_outcome_reason_is_one_record(tree: TreeCopy):
    path = "specs/data/outcomes.py"
    tree.replace(path, '    "deadlock",\n]', '    "deadlock",\n    "overheated",\n]')
    tree.replace(
        path,
        'cancelled a goal of the navigation.", OTHER_MARK),\n',
        'cancelled a goal of the navigation.", OTHER_MARK),\n'
        '    ReasonRecord("overheated", "The motor was too hot.", Mark("hot", "<path/>", *["#ff0000"] * 4)),\n',
    )
    made = tree.run(
        "from specs.data.outcomes import MARKS, mark_of\n"
        "from tasks.simulate.application.contract import REASONS\n"
        "from tests.factories.episodes import collided\n"
        "from specs.data.episode import EpisodeResult, reason\n"
        "row = EpisodeResult.model_validate({**collided(0).model_dump(), 'outcome_reason': 'overheated'})\n"
        "print(REASONS.index('overheated'), reason(row), mark_of('overheated').name, mark_of('overheated') in MARKS)"
    )
    assert made.split() == ["9", "overheated", "hot", "True"]
    tree.followed("an outcome reason")


def test_an_export_format_is_a_writer_and_a_record(tree: TreeCopy):
    tree.write(
        "tasks/export/format/names.py",
        '"""The names of a world\'s rooms."""\n\nfrom specs.data.world import World\n\n\n'
        "def names_text(world: World) -> bytes:\n"
        '    """Returns a line a room."""\n'
        '    return "\\n".join(room.name for room in world.rooms).encode()\n',
    )
    tree.replace("specs/pipeline/world_sections.py", '"glb", "usd"]', '"glb", "usd", "names"]')
    tree.add_before(
        "tasks/export/format/formats.py",
        "_RECORDS = (",
        "def _names(world: World) -> Mapping[str, bytes]:\n"
        "    from tasks.export.format.names import names_text\n\n"
        '    return {f"{_place(world)}.txt": names_text(world)}\n\n\n',
    )
    tree.replace(
        "tasks/export/format/formats.py",
        'needs=("pxr",)),\n',
        'needs=("pxr",)),\n    ExportFormat("names", "a text editor", _names),\n',
    )
    made = tree.run(
        "from specs.pipeline.document import PipelineSpec\n"
        "from tasks.export.format.formats import format_files\n"
        "from tests.factories.worlds import apartment\n"
        "worlds = {'template': 't', 'worldCount': {'floorplanCount': 1}}\n"
        "PipelineSpec.model_validate({'name': 'n', 'worldGeneration': worlds, 'worldExport': "
        "{'outputLocation': {'s3Bucket': 'worlds', 's3Prefix': 'n'}, 'formats': ['names']}})\n"
        "print(*format_files(apartment(), 'names'))"
    )
    assert made.strip().startswith("names/")
    assert made.strip().endswith(".txt")
    tree.followed("an export format")


def test_a_failure_code_is_one_name(tree: TreeCopy):
    path = "specs/robomaker/failure_codes.py"
    tree.replace(path, '    "AllWorldGenerationFailed",\n', '    "AllWorldGenerationFailed",\n    "RoofOnFire",\n')
    made = tree.run(
        "from specs.robomaker.world_jobs import DescribeWorldGenerationJobResponse as Answer\n"
        "from tasks.storage.jobs.records import advance, submit\n"
        "from tasks.storage.store_url import open_store\n"
        "from pathlib import Path\n"
        "store = open_store(Path('store').absolute().as_uri())\n"
        "kind = 'world-generation-job'\n"
        "record = submit(store, kind, {}, 'token')\n"
        "record = advance(store, kind, record.id, 'Failed', failure_code='RoofOnFire')\n"
        "print(record.failure_code, 'RoofOnFire' in str(Answer.model_json_schema()))"
    )
    assert made.split() == ["RoofOnFire", "True"]
    tree.followed("a failure code")


@pytest.mark.long
def test_a_gate_rule_is_a_section_and_a_module(tree: TreeCopy):
    section = "specs/pipeline/gate_section.py"
    tree.add_before(
        section,
        "class QuantileRule(Ruled):",
        "class SpeedLimit(Spec):\n"
        '    """How fast an episode may be on average."""\n\n'
        '    atMost: Number = Field(title="At most")\n\n\n',
    )
    tree.add_before(
        section,
        "    # None, not False: documents without it",
        '    speedLimit: SpeedLimit | None = Field(default=None, title="Speed limit")\n',
    )
    tree.write("tasks/results/gate/rules/speed_limit.py", SPEED_LIMIT)
    gate = "tasks/results/gate/gate_verdict.py"
    tree.add_before(
        gate,
        "from tasks.results.gate.rules.success_rate",
        "from tasks.results.gate.rules.speed_limit import SPEED_LIMIT\n",
    )
    tree.replace(gate, "    RARE_FAILURE,\n)", "    RARE_FAILURE,\n    SPEED_LIMIT,\n)")
    made = tree.run(
        "from flows.preview.gate_plan import PlannedEpisodes\n"
        "from specs.pipeline.gate_section import Gate\n"
        "from tasks.results.gate.gate_verdict import GATE_RULES, columns_needed, count_rows, judge\n"
        "from tasks.results.gate.rules.rule import GateMaterial\n"
        "from tasks.results.tables.episode_tables import results_table\n"
        "from tests.factories.episodes import passed, request\n"
        "gate = Gate.model_validate({'speedLimit': {'atMost': 5.0}})\n"
        "rows = results_table('b', [request(0)], [passed(0)]).select(columns_needed(gate))\n"
        "verdict = judge(gate, GateMaterial(counts=count_rows(rows), rows=rows))\n"
        "planned = PlannedEpisodes(episodes=1, pairs=0, audited=0)\n"
        "(rule,) = [rule for rule in GATE_RULES if rule.asked(gate)]\n"
        "print(verdict.verdict, *rule.plan(gate.speedLimit, planned), sep='|')"
    )
    assert made.strip() == "PASS|at most 5 m/s on average"
    tree.followed("a gate rule")


SPEED_LIMIT = '''"""The rule ``speedLimit``: no episode is faster on average than a bar."""

from tasks.results.gate.rules.rule import GateRule, RuleVerdict


def _judge(asked, material, label):
    rows = material.ended_rows()
    paths, times = (rows.column(name).to_pylist() for name in ("path_length_m", "simulated_s"))
    fast = any(path > asked.atMost * time for path, time in zip(paths, times, strict=True))
    return RuleVerdict(rule=label, verdict="FAIL" if fast else "PASS", sentence="", counted=len(paths))


def _plan(asked, _planned):
    yield f"at most {asked.atMost:g} m/s on average"


SPEED_LIMIT = GateRule("speedLimit", _judge, _plan, lambda _: ("path_length_m", "simulated_s"))
'''


def test_a_job_kind_is_declared_once_and_registered_once(tree: TreeCopy):
    kinds = "specs/job_kinds.py"
    tree.replace(kinds, '"deployment-job", "pipeline-run"]', '"deployment-job", "map-survey-job", "pipeline-run"]')
    tree.add_before(
        kinds,
        "    # Runs of a document are numbered",
        "    JobDeclaration(\n"
        '        "map-survey-job",\n        prefix="msj",\n        part="survey",\n        event="map-survey",\n'
        '        objects=(JobObjects("surveys", ("surveys/{survey}.json",)),),\n    ),\n',
    )
    commands = "flows/resources/kinds.py"
    tree.add_before(
        commands,
        "_LOADS: Mapping[ResourceKind, Callable[[], Resource]] = {\n",
        "def _map_survey_job() -> Resource:\n"
        "    from tasks.storage.jobs.records import cancel_watched_job\n"
        "    from tasks.storage.jobs.records import records\n\n"
        '    kind: JobKind = "map-survey-job"\n'
        "    return Resource(\n"
        "        lambda store, path: read(store, kind, path),\n"
        "        lambda store: records(store, kind),\n"
        "        cancel=lambda store, path: cancel_watched_job(store, kind, path),\n    )\n\n\n",
    )
    tree.add_before(commands, '    "pipeline-run": _pipeline_run', '    "map-survey-job": _map_survey_job,\n')
    made = tree.run(
        "from pathlib import Path\n"
        "from flows.resources.kinds import describe_resource, list_resources\n"
        "from flows.resources.kinds import cancel_resource\n"
        "from tasks.housekeeping.object_kinds import kind_of_key\n"
        "from tasks.storage.jobs.records import submit\n"
        "from tasks.storage.store_url import open_store\n"
        "store = open_store(Path('store').absolute().as_uri())\n"
        "job = submit(store, 'map-survey-job', {}, 'token')\n"
        "cancel_resource(store, job.arn)\n"
        "listed = list(list_resources(store, 'map-survey-jobs'))\n"
        "print(job.id[:4], describe_resource(store, job.arn).status, len(listed), "
        "kind_of_key(f'surveys/{job.id}.json').what)"
    )
    assert made.split() == ["msj-", "Canceled", "1", "surveys"]
    tree.followed("a job kind")


@pytest.mark.long
@pytest.mark.parametrize("engine", ["planar", "mujoco", pytest.param("mjx", marks=pytest.mark.soak)])
def test_a_sensor_is_a_module_and_a_line_for_every_engine(tree: TreeCopy, engine: str):
    tree.write("tasks/simulate/sensors/gyroscope.py", GYROSCOPE)
    table = "tasks/simulate/sensors/sensor_table.py"
    tree.add_before(
        table,
        "from tasks.simulate.sensors.lidar import",
        "from tasks.simulate.sensors.gyroscope import GYROSCOPE, Gyroscope\n",
    )
    last = "    gps: Gps | None = None\n"
    tree.replace(table, last, f"{last}    gyroscope: Gyroscope = Gyroscope(0)\n")
    tree.replace(table, "CLIFF_SENSORS, GPS)", "CLIFF_SENSORS, GPS, GYROSCOPE)")
    after = "\n\n\nclass Controller(Protocol):"
    field = '    gyroscope_rad_s: Float[jax.Array, "axes"] | None = None'
    tree.replace("tasks/simulate/application/contract.py", after, f"\n{field}{after}")
    shutil.copytree(ROOT / "tests/simulate/bundles/faulty", tree.root / "bundle")
    controller = tree.root / "bundle/faulty/pushing.py"
    text = controller.read_text().replace("    lidar = Lidar()\n", "    lidar = Lidar()\n    gyroscope = Lidar()\n", 1)
    text = text.replace("class Lidar(NamedTuple):", "class Lidar(NamedTuple):\n    axes: int = 1")
    controller.write_text(text.replace("jnp.float32(0.4)", "jnp.float32(0.4) + observation.gyroscope_rad_s[0]"))
    assert simulated(tree, engine) == "Completed"
    tree.followed("a sensor")


GYROSCOPE = '''"""The gyroscope: how fast the robot turns."""

from typing import NamedTuple

import jax.numpy as jnp

from tasks.simulate.sensors.sensor import Sensor


class Gyroscope(NamedTuple):
    """One around the vertical axis; 0 axes are none."""

    axes: int


def _observe(shared, _own, _memory, situation):
    return {"gyroscope_rad_s": jnp.broadcast_to(situation.body.qvel[2], (shared.axes,))}


GYROSCOPE = Sensor(
    name="gyroscope",
    kind=Gyroscope,
    absent=Gyroscope(axes=0),
    blank=lambda shared: {"gyroscope_rad_s": jnp.zeros(shared.axes)},
    observe=_observe,
    limits={"axes": (1, 1)},
    whole=("axes",),
    shared=("axes",),
)
'''


@pytest.mark.long
def test_an_engine_is_a_folder_and_a_record(tree: TreeCopy):
    tree.write(
        "tasks/simulate/engines/tin/tin_engine.py",
        '"""The tin engine."""\n\nfrom dataclasses import replace\n\n'
        "from tasks.simulate.engines.planar.planar_engine import planar_mechanics\n\n\n"
        "def tin_mechanics(path):\n    return replace(planar_mechanics(path), engine='tin')\n",
    )
    tree.replace(
        "specs/field_types.py",
        'Literal["planar", "mjx", "mujoco"]',
        'Literal["planar", "mjx", "mujoco", "tin"]',
    )
    engines = "tasks/simulate/engines/engine_table.py"
    tree.add_before(
        engines,
        "ENGINES: Mapping[EngineName, Engine] = {\n",
        "def _load_tin(robot, applications, lanes, host):\n"
        "    from tasks.simulate.engines.compiled_program import compiled_program\n"
        "    from tasks.simulate.engines.tin.tin_engine import tin_mechanics\n\n"
        "    return compiled_program(tin_mechanics(robot), applications, lanes, host)\n\n\n",
    )
    tree.add_before(
        engines,
        '    "mjx": Engine(\n',
        '    "tin": Engine({"cpu": 4, "gpu": 4}, _read_planar, _load_tin, '
        "EngineCost(1.0, 1.0, 1e-6, 1e-6, 1e-3, _MIB, _MIB)),\n",
    )
    shutil.copytree(ROOT / "tests/simulate/bundles/faulty", tree.root / "bundle")
    assert simulated(tree, "tin") == "Completed"
    tree.followed("an engine")
