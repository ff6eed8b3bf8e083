"""`simyard plan`: what a run would do, without doing it."""

import math
import os
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from flows.pipeline.launch_notes import environments, report_lines, ros_launch_faults, topic_lines
from flows.pipeline.references import finder, new_bucket_lines, resolve_references
from flows.pipeline.robot_drafts import with_drafts, with_store_drafts
from flows.pipeline.tested_batch import bundle_files_in, failing_sources, shuffle_if_endable, with_launched_worlds
from flows.pipeline.version_retention import version_lines
from flows.pipeline.world_imports import imported_lines
from flows.preview.gate_plan import GateBasis, deployment_lines, gate_basis, gate_lines
from specs.base import Fault
from specs.data.episode import ApplicationLaunch
from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec, inert_fields
from specs.pipeline.gate_section import Gate
from specs.pipeline.generation_parts import MAX_WORLDS_OF_DOCUMENT
from specs.pipeline.search_section import Search
from specs.pipeline.section_requests import section_parts
from specs.pipeline.simulation_section import SimulationBatch
from specs.pipeline.world_sections import WorldGeneration
from specs.template.body import TemplateBody
from tasks.applications.registry import unpack
from tasks.documents.parse import parse
from tasks.documents.pipeline_file import names_a_file
from tasks.documents.source_text import read_document
from tasks.results.playback.replay_formats import is_installed
from tasks.results.statistics.power import effective_episodes
from tasks.ros.launch.launch_plan import LaunchSource
from tasks.simulate.application.mjcf_check import refusal_lines
from tasks.simulate.forecast.batch_times import Span
from tasks.simulate.forecast.camera_costs import CameraPlan
from tasks.simulate.forecast.forecast import EnginePlan, engine_plan, node_bytes, nodes_pace
from tasks.simulate.geometry.obstacles import grid_cells
from tasks.simulate.host.declaration import controller_kind
from tasks.simulate.host.unread_variables import unread_variables
from tasks.simulate.plan.batch_plan import DEFAULT_LANES, BatchPlan
from tasks.simulate.plan.plan_batch import FindVersion, matrix_worlds, plan_batch
from tasks.simulate.sandbox.confinement import confinement
from tasks.simulate.sandbox.launch_check import LaunchReport, check_launch_file
from tasks.simulate.sandbox.process_environment import left_out
from tasks.storage.backends.overlay import OverlayStore
from tasks.storage.base.keys import jobs_prefix
from tasks.storage.base.local_files import cache_folder
from tasks.storage.base.store import Store
from tasks.worlds.unused_sets import unused_sets

ASSUMED = (0.0, 0.05, 0.1)
_NIGHTS = 5
_WORTH_SAYING = 0.75
_LAYOUTS = 2
_LITTLE_S, _LITTLE = 5.0, 0.25


class SeenSpread(NamedTuple):
    """How alike the episodes of one world were.

    Attributes:
        nights: In how many earlier batches, the newest.
        icc: Their intra-world correlation in the mean, 0-1; None where too few failed to say.
    """

    nights: int
    icc: float | None


def seen_spread(store: Store, document: str) -> SeenSpread | None:
    """Returns how alike episodes of a world were in a document's newest batches; None where there is none.

    Of batches that the cache folder knows, nothing is read from the store.

    Args:
        store: Where the document's runs are.
        document: Its name.
    """
    if next(iter(store.keys(jobs_prefix("pipeline-run"))), None) is None:
        return None
    from flows.batch.trend_history import read_history  # noqa: PLC0415 - tables, where there is something to read
    from tasks.results.statistics.over_worlds import world_spread  # noqa: PLC0415 - likewise
    from tasks.results.trend.trend_series import Measure  # noqa: PLC0415 - likewise

    counted = [night for night in read_history(store, document, Measure()).nights if night.cells]
    newest = sorted({night.request: night for night in counted}.values(), key=lambda night: night.begun_at_s)[-_NIGHTS:]
    iccs: list[float] = []
    for night in newest:
        passed, episodes = Counter[str](), Counter[str]()
        for cell in night.cells:
            passed[cell.world] += cell.successes
            episodes[cell.world] += cell.n
        found = world_spread([passed[world] for world in episodes], list(episodes.values())).icc
        iccs += [] if found is None else [found]
    return SeenSpread(len(newest), sum(iccs) / len(iccs) if iccs else None) if newest else None


def world_lines(gate: Gate, seen: SeenSpread | None, *, episodes: int, worlds: int, seeds: int) -> Iterator[str]:
    """Yields what a batch's layout is worth, where that matters: a rule over worlds, or episodes that are alike.

    Args:
        gate: The document's gate.
        seen: What earlier batches showed; None of none.
        episodes: Of the tested version.
        worlds: In how many worlds they are.
        seeds: Of the matrix.
    """
    over = any(
        getattr(rule, "over", None) == "worlds"
        for rule in [gate.successRate, gate.collisionRate, gate.noWorseThan, *(gate.quantiles or ())]
    )
    icc = seen.icc if seen else None
    if not worlds or not episodes or not (over or icc):
        return
    per_world = max(1, round(episodes / worlds))
    laid_out = f"{worlds} worlds x {per_world} episodes"
    if icc is None:
        worth = " / ".join(f"{effective_episodes(worlds, per_world, each):.0f}" for each in ASSUMED)
        why = "earlier batches: too few failed" if seen else "no earlier batch"
        yield f"{why}: {laid_out} are worth {worth} independent ones at an ICC of 0 / 0.05 / 0.1"
    else:
        batches = f"{seen.nights if seen else 0} earlier batch{'' if seen and seen.nights == 1 else 'es'}"
        worth = f"{effective_episodes(worlds, per_world, icc):.0f}"
        yield f"{batches}: ICC {icc:.2f}; {laid_out} are worth {worth} independent ones in worlds like these"
    yield from _better(icc if icc is not None else ASSUMED[1], episodes, worlds, seeds)


def _better(icc: float, episodes: int, worlds: int, seeds: int) -> Iterator[str]:
    """Yields a layout of as many episodes that is worth much more, with what to write."""
    now = effective_episodes(worlds, max(1, round(episodes / worlds)), icc)
    layouts = [(worlds * seeds // each, each) for each in range(1, seeds) if seeds % each == 0]
    layouts = [layout for layout in layouts if layout[0] <= MAX_WORLDS_OF_DOCUMENT]
    for more, left in layouts[:: max(1, len(layouts) - 1)][::-1][:_LAYOUTS]:
        per_world = max(1, round(episodes / more))
        worth = effective_episodes(more, per_world, icc)
        if now < _WORTH_SAYING * worth:
            written = f"worldCount: {{floorplanCount: {more}}} and seeds: {left}"
            yield f"{more} worlds x {per_world} would be worth {worth:.0f}: write {written}"


_REQUESTS = "simulationBatch.createSimulationJobRequests[*].robotApplications[*].launchConfig"


class HostPlan(NamedTuple):
    """What is going to run beside the programs of a batch.

    Attributes:
        launches: What is known of each ROS launch file.
    """

    launches: Mapping[LaunchSource, LaunchReport]

    @property
    def simulated_clock(self) -> frozenset[str]:
        """Returns the launch files that make nodes wait for ``/clock``."""
        return frozenset(source.launch_file for source, each in self.launches.items() if each.simulated_clock)


def host_plan(batch: BatchPlan, folders: Mapping[str, Path], own: Collection[str]) -> HostPlan:
    """Returns what runs beside the programs of a batch.

    Args:
        batch: The batch.
        folders: Unpacked folders of its applications, by digest.
        own: Digests of the bundles that the document brings along.
    """
    launches: dict[LaunchSource, LaunchReport] = {}
    for template in batch.templates:
        for launch in (template.robot, template.scenario) if template.scenario.starts_nodes else (template.robot,):
            folder = folders[launch.digest]
            kind, source = controller_kind(folder, launch), _source(folder, launch)
            if kind in {"ros", "ros2"} and source not in launches:
                values = template.judge_variables if launch is template.scenario else template.environment
                asked = environments(values, batch.sweep)
                launches[source] = check_launch_file(source, asked, own=launch.digest in own)
    return HostPlan(launches)


def host_faults(plan: HostPlan) -> list[Fault]:
    """Returns a fault for each launch file that roslaunch refuses, and for each wrong ``ros.yaml``."""
    return [fault for source, report in plan.launches.items() for fault in ros_launch_faults(_REQUESTS, source, report)]


def host_lines(plan: HostPlan, lanes: int) -> Iterator[str]:
    """Yields what a person is to know of it; ``lanes`` is how many episodes run side by side."""
    said: dict[str, None] = {}
    for source, report in plan.launches.items():
        if report.has_ros:  # else jobs will fail, which is said with the reason
            said.update(dict.fromkeys(report_lines(source, report)))
        if report.nodes:
            processes = lanes * len(report.nodes)
            gigabytes = math.ceil(processes * node_bytes() / 1e8) / 10
            pace = nodes_pace(lanes, len(report.nodes))
            started = f"{_counted(lanes, 'lane')} at once: {_counted(processes, 'process', 'processes')}"
            said[
                f"{started} of up to {gigabytes:.1f} GB together; about "
                f"{pace.low:,.0f} to {pace.high:,.0f} control steps a second in all"
            ] = None
    said.update(dict.fromkeys(topic_lines([*plan.launches.values()])))
    yield from said


def host_failures(plan: HostPlan) -> list[str]:
    """Returns why jobs will fail for what is not installed on this machine."""
    return list(dict.fromkeys(report.ros for report in plan.launches.values() if not report.has_ros))


def _counted(number: int, one: str, many: str = "") -> str:
    return f"{number} {one if number == 1 else many or one + 's'}"


def _source(folder: Path, robot: ApplicationLaunch) -> LaunchSource:
    return LaunchSource(folder, robot.package, robot.launch_file, robot.command)


_ROBOTS = "simulationBatch.createSimulationJobRequests[*].robotApplications"
_UNITS = (("h", 3600.0), ("min", 60.0), ("s", 1.0))


def plan_lines(spec: PipelineSpec, base: Path, store: Store) -> Iterator[str]:
    """Yields lines for a person: each stage, what it makes, and the fields that have no effect.

    Raises:
        DocumentError: The document refers to what does not exist, or names robots that no engine takes; before the
            first line, all of it at once.
    """
    trial = OverlayStore(store)  # bundles are published as a run would, and forgotten
    found, drafted = resolve_references(spec, trial, base), with_drafts(spec, base).notes
    find = finder(trial, found.bundled)
    spec, imported = found.placed(spec), list(found.imported_digests())
    batch, plan, beside = _planned(spec, trial, find, found.bundled_digests(), imported)
    yield f"{spec.name}, on {store.url}"
    yield from (f"applications      {line}" for line in version_lines(spec, store, trial))
    yield from (f"{'' if number else 'draft':<18}{line}" for number, line in enumerate(drafted))
    worlds = enumerate(imported_lines(found.imported_by_name()))
    yield from (f"{'' if number else 'worlds':<18}{line}" for number, line in worlds)
    if spec.worldGeneration:
        yield _generation_line(spec.worldGeneration)
    if spec.worldExport:
        place = spec.worldExport.outputLocation
        yield f"worldExport       {', '.join(spec.worldExport.formats)} to {place.s3Bucket}/{place.s3Prefix or ''}"
    yield from (f"output            {line}" for line in new_bucket_lines(spec, store))
    judged = GateBasis(0, 0)
    if spec.simulationBatch and found.batch and batch and plan and beside:
        if spec.gate:
            judged = gate_basis(batch, spec.gate.noWorseThan, found.compared_with, trial)
        driven = {grid_cells(each.world) for each in found.imported if each.reference in batch.worlds}
        yield from _batch_lines(plan, batch, spec.simulationBatch, sizes=len(driven))
        yield from (f"                  {line}" for line in host_lines(beside, min(plan.lanes, plan.episodes)))
        for reason in (*failing_sources(found.batch), *host_failures(beside)):
            yield f"jobs will fail    {reason}"
        yield from _search_lines(spec.search, batch, plan, _folders(batch, trial))
        yield from (f"no effect?        {line}" for line in _unread(batch, _folders(batch, trial)))
    if spec.gate:
        judged = replace(judged, searched=spec.search.budget.episodes if spec.search else 0)
        yield from _gate_lines(spec.gate, judged, batch, plan, seen_spread(store, spec.name))
    if spec.deployment and found.ships:
        clocks = beside.simulated_clock if beside else frozenset[str]()
        lines = deployment_lines(
            spec.deployment, trial, find, found.ships, batch, judged=spec.gate is not None, simulated_clock=clocks
        )
        yield from (f"{'' if number else 'deployment':<18}{line}" for number, line in enumerate(lines))
    for field in (*inert_fields(spec), *_unused_in_template(spec.worldGeneration, base)):
        yield f"no effect         {field}"
    if spec.simulationBatch and (names := left_out(os.environ)):
        yield f"no effect         {', '.join(names)}: what simulates has variables of its own"


def _gate_lines(
    gate: Gate, judged: GateBasis, batch: BatchPlan | None, plan: EnginePlan | None, seen: SeenSpread | None
) -> Iterator[str]:
    """Yields what the gate needs, and what the batch's layout is worth to it."""
    if batch is None or plan is None:
        yield from gate_lines(gate, judged, 0)
        return
    worlds = len({world for template in batch.templates for world in batch.worlds_of(template)})
    icc = seen.icc if seen else None
    pairs = shuffle_if_endable(batch, gate).shuffled == "pairs"
    programs, lanes = plan.compilations, plan.lanes
    yield from gate_lines(gate, judged, plan.audited, programs, worlds=worlds, lanes=lanes, pairs=pairs, icc=icc)
    advice = world_lines(gate, seen, episodes=judged.episodes, worlds=worlds, seeds=len(batch.seeds_used()))
    yield from (f"                  {line}" for line in advice)


def _unused_in_template(section: WorldGeneration | None, base: Path) -> list[str]:
    """Returns what in a template beside the document, or in it, has no effect."""
    if section is None:
        return []
    template = section.template
    if isinstance(template, str):
        if not names_a_file(template):
            return []
        template = parse(TemplateBody, read_document(base / template), template)
    return [f"worldGeneration.template: {line}" for line in unused_sets(template)]


def _generation_line(section: WorldGeneration) -> str:
    count = section.worldCount
    worlds = _count(count.floorplanCount * count.interiorCountPerFloorplan, "world")
    product = f"{_count(count.floorplanCount, 'floor plan')} x {_count(count.interiorCountPerFloorplan, 'interior')}"
    seeded = f"seed {section.seed}, for a robot of {section.robotRadius:g} m radius"
    jobs = len(section_parts(section))
    of_jobs = f" by {jobs} jobs" if jobs > 1 else ""
    return f"worldGeneration   {worlds} ({product}){of_jobs}, {seeded}"


def _planned(
    spec: PipelineSpec, store: Store, find: FindVersion, own: Collection[str], imported: Sequence[str]
) -> tuple[BatchPlan, EnginePlan, HostPlan] | tuple[None, None, None]:
    """Returns the batch, over stand-ins for worlds that are not made yet, how it would be simulated, and what beside.

    Args:
        spec: The document.
        store: Where bundles are.
        find: Finds versions.
        own: Digests of the bundles that the document brings along.
        imported: ``<generation>/<world>`` of each world that it imports.

    Raises:
        DocumentError: No engine takes a robot, or roslaunch refuses a launch file; carries each refusal of each robot.
    """
    if spec.simulationBatch is None:
        return None, None, None
    count = spec.worldGeneration.worldCount if spec.worldGeneration else None
    worlds = count.floorplanCount * count.interiorCountPerFloorplan if count else 0
    names = [*imported, *(f"planned/world-{number}" for number in range(worlds))]
    worlds_used = matrix_worlds(spec.simulationBatch, names)
    batch = plan_batch(spec.simulationBatch, worlds_used, {}, find, find_files=bundle_files_in(store))
    batch = with_launched_worlds(with_store_drafts(batch, store), spec.simulationBatch, store)
    folders = _folders(batch, store)
    plan, beside = engine_plan(batch, folders), host_plan(batch, folders, own)
    faults = [
        Fault(path=_ROBOTS, value=robot.robot, allowed=f"a robot that an engine takes, and not this one: {fault}")
        for robot in plan.robots
        for fault in refusal_lines(robot.refusal)
    ]
    if faults := [*faults, *host_faults(beside)]:
        raise DocumentError(list(dict.fromkeys(faults)))
    return batch, plan, beside


def _folders(batch: BatchPlan, store: Store) -> dict[str, Path]:
    return {digest: unpack(store, digest, cache_folder() / "bundles") for digest in batch.digests()}


def _unread(batch: BatchPlan, folders: Mapping[str, Path]) -> list[str]:
    """Returns what is to be said of variables that none of their episodes' applications name."""
    found: list[str] = []
    for template in batch.templates:
        launches = template.robot, template.scenario
        if any(each.command for each in launches):
            continue  # the files of an image are in its layers
        names = sorted(each for each in template.environment.keys() | batch.sweep.keys() if each.isidentifier())
        found += unread_variables({each.name: folders[each.digest] for each in launches}, names)
    return list(dict.fromkeys(found))


def _batch_lines(plan: EnginePlan, batch: BatchPlan, section: SimulationBatch, sizes: int) -> Iterator[str]:
    """Yields how a batch is simulated; ``sizes`` are those of the maps of worlds that are there already."""
    longest_s = max((template.duration_s for template in batch.templates), default=0.0)
    yield f"simulationBatch   {_count(plan.episodes, 'episode')} of at most {longest_s:g} simulated seconds"
    if batch.robots:
        shared = _count(plan.episodes // batch.robots, "time")
        yield f"                  {batch.robots} robots share a world, {shared}; each is an episode; none is audited"
    for robot in plan.robots:
        if robot.choice:
            yield f"                  {robot.robot}: engine {robot.choice.engine}, {robot.choice.why}"
            yield from (f"                  {robot.robot}: strange: {line}" for line in robot.choice.strange)
    chunks = f"{_count(plan.chunks, 'chunk')} of {_count(plan.lanes, 'lane')}"
    devices = _count(plan.devices, f"{plan.device} device")
    steps = f"at most {plan.lane_steps_at_most:,} physics steps"
    programs = _count(plan.compilations, "compiled program")
    programs += f" for each of {sizes} sizes of worlds" if sizes > 1 else ""
    yield f"                  {chunks} on {devices}, {programs}, {steps}"
    took = f"{_time(plan.wall_s, known=plan.known)} and {_gigabytes(plan.memory_bytes)}"
    if plan.known:
        yield f"                  about {took}; from the last batch of these programs here{_compiling(plan)}"
    else:
        yield f"                  time and memory unknown until these programs have run here: perhaps {took}"
    yield from (f"                  {_camera(each, plan)}" for each in plan.cameras)
    yield f"                  {_recordings(section)}{_bags(batch)}; {_audit(plan)}"
    yield f"                  applications run {confinement().sentence}"


def _compiling(plan: EnginePlan) -> str:
    """Returns how much longer a batch takes that has to compile; empty where that is little."""
    if plan.compile_s < max(_LITTLE_S, _LITTLE * plan.wall_s.middle):
        return ""
    return f"; up to {plan.compile_s:.0f} s more where it has to compile, as for worlds of another size"


def _search_lines(
    search: Search | None, batch: BatchPlan, plan: EnginePlan, folders: Mapping[str, Path]
) -> Iterator[str]:
    """Yields what a search varies, what it costs beside its batch, and when it ends.

    Args:
        search: The document's section.
        batch: The batch that is searched.
        plan: How the batch is simulated.
        folders: Unpacked folders of its applications, by digest.
    """
    if search is None:
        return
    most, over = search.episodes, ", ".join([*sorted(search.over), "worlds and seeds"])
    yield f"search            up to {_count(most, 'episode')} beside the batch's {plan.episodes:,}, over {over}"
    yield f"                  failures are where {search.measure} is below 0, and where an episode does not pass"
    if search.against:
        yield f"                  and version {search.against} passes, which drives those that fail besides"
    yield f"                  reports up to {search.find.distinct} unlike each other, driven again on C MuJoCo too"
    alike = batch.model_copy(
        update={
            "seeds": tuple(range(-(-most // max(1, len(batch.worlds_of(batch.templates[0])))))),
            "sweep": {name: values[:1] for name, values in batch.sweep.items()},
            "lanes": max(batch.lanes, DEFAULT_LANES),
            "audit": 0,
        }
    )
    whole = engine_plan(alike, folders)
    took = _time(whole.wall_s, known=whole.known)
    unknown = f"time unknown until these programs have run here: perhaps {took}"
    known = f"about {took} for all of them; from the last batch of these programs here{_compiling(whole)}"
    yield f"                  {known if whole.known else unknown}"
    sure = f"{100 * search.estimate.confidence:g} % interval"
    if search.estimate.relativeError is None:
        yield f"                  spends its budget; {sure}"
        return
    reach = f"{100 * search.estimate.relativeError:g} % of the probability"
    yield f"                  ends when the {sure} reaches {reach} to either side, or the budget is spent"


def _camera(camera: CameraPlan, plan: EnginePlan) -> str:
    """Returns what a camera costs, and the batch's time without it."""
    size = f"of {camera.columns}x{camera.rows} at {camera.rate_hz:g} Hz"
    several = f"{camera.cameras} of " if camera.cameras > 1 else ""
    shown = f"{several}{camera.kind} {'whose size its code knows; one ' if camera.assumed else ''}{size}"
    pictures = f"{_rounded(camera.pictures.low)} to {_rounded(camera.pictures.high)} pictures a second of a core"
    part = Span(low=min(camera.batch_s.low, plan.wall_s.low), high=min(camera.batch_s.high, plan.wall_s.high))
    least, most = plan.wall_s.low - part.low, plan.wall_s.high - part.high
    without = _time(Span(low=min(least, most), high=max(least, most)), known=False)
    if part.high < 1.0:
        return f"{camera.robot}: {shown}: {pictures}; less than a second"
    return f"{camera.robot}: {shown}: {pictures}; at most {_time(part, known=False)}, without it {without}"


def _rounded(number: float) -> str:
    """Returns a number with two digits that count."""
    return f"{float(f'{number:.2g}'):,.0f}"


def _count(number: int, thing: str) -> str:
    return f"{number:,} {thing}{'' if number == 1 else 's'}"


def _time(span: Span, *, known: bool) -> str:
    """Returns a time, with its range; of one that is not known the range alone."""
    unit, seconds = next(each for each in _UNITS if span.high >= 2 * each[1] or each[1] == 1.0)
    digits = 0 if seconds == 1.0 else 1
    low, middle, high = (f"{each / seconds:.{digits}f}" for each in (span.low, span.middle, span.high))
    return f"{middle} {unit} ({low} to {high})" if known else f"{low} to {high} {unit}"


def _gigabytes(span: Span) -> str:
    return f"{span.low / 1e9:.1f} to {span.high / 1e9:.1f} GB of memory"


def _recordings(section: SimulationBatch) -> str:
    asked, requests = section.recordings, section.createSimulationJobRequests
    every = sum(bool(each.loggingConfig and each.loggingConfig.recordAllRosTopics) for each in requests)
    also = f"all of {_count(every, 'request')} with recordAllRosTopics" if every and asked.episodes != "all" else ""
    if asked.episodes == "none":
        return f"recordings of {also} at {asked.rateHz:g} Hz" if also else "no recordings"
    more = f", and {also}" if also else ""
    seen = f", pictures at {asked.picturesHz:g} Hz" if asked.picturesHz else ""
    return f"recordings of {asked.episodes} episodes at {asked.rateHz:g} Hz{seen}{more}"


def _bags(batch: BatchPlan) -> str:
    """Returns in which formats recorded episodes are written for ROS's tools, and why not."""
    formats = dict.fromkeys(each for template in batch.templates for each in batch.bags_of(template))
    if not formats or not batch.makes_bags():
        return ""
    if not is_installed("ros"):
        return ", no bags: simyard[ros] is not installed"
    return f", bags as {' and '.join(formats)}"


def _audit(plan: EnginePlan) -> str:
    if not plan.audited:
        return "no audit"
    if all(robot.choice and robot.choice.engine == "mujoco" for robot in plan.robots):
        return f"{_count(plan.audited, 'episode')} driven twice, and no audit: mujoco is the reference itself"
    return f"{_count(plan.audited, 'episode')} audited on C MuJoCo"
