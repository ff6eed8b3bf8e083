"""Replays an episode of a batch, and simulates some of its episodes again, together, as its chunks were simulated."""

import functools
from collections.abc import Mapping, Sequence
from math import inf
from pathlib import Path
from typing import NamedTuple

from specs.data.episode import EpisodeRequest, EpisodeResult, Failure, failed_result
from specs.data.world import World
from specs.errors import ResourceNotFound
from tasks.simulate.application.bundle_code import crash_code
from tasks.simulate.batch.batch_record import OpenBatch, StopWatch
from tasks.simulate.batch.chunk_run import (
    ChunkPart,
    PreparedChunk,
    Simulate,
    batch_mounts,
    chunks_ahead,
    load_worlds,
)
from tasks.simulate.plan.chunks import Chunk, most_steps, plan_chunks
from tasks.simulate.replay.replay_result import ReplayResult, received_replay
from tasks.simulate.sandbox.process_pool import ask_exclusive
from tasks.simulate.sandbox.protocol import Crashed, NoMemory, Replayed, ReplayWork
from tasks.simulate.sandbox.sandbox_client import Results, retry_with_fewer_lanes
from tasks.simulate.sandbox.simulator import Simulator, SimulatorEnded


def drive_apart(
    request: EpisodeRequest,
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str,
    rate_hz: float,
    beside: Sequence[EpisodeRequest] = (),
) -> ReplayResult:
    """Returns an episode driven to its end, as ``drive_replay``, which takes the same.

    Raises:
        MemoryError: There is not enough memory for so many lanes.
        SimulatorEnded: The process ended, but for in an application's code: such an episode has its row.
    """
    bundles = {digest: folder for digest, folder in bundles.items() if digest in request.bundles}

    def question(process: Simulator) -> ReplayWork:
        return ReplayWork(
            request=request,
            beside=tuple(beside),
            worlds=process.sent_worlds({request.world: worlds[request.world]}),
            bundles={digest: str(folder) for digest, folder in bundles.items()},
            lanes=lanes,
            engine=engine,
            rate_hz=rate_hz,
        )

    try:
        answer, arrays = ask_exclusive(bundles, question)
    except SimulatorEnded as ended:
        if ended.out_of_memory:
            raise
        return ReplayResult(failed_result(request.index, Failure(crash_code(ended.code), ended.reason)))
    match answer:
        case Replayed() as again:
            return received_replay(again, arrays, most_steps([request]))
        case Crashed() as crashed:
            return ReplayResult(failed_result(request.index, Failure(crashed.code, crashed.reason)))
        case NoMemory() as lack:
            raise MemoryError(lack.text)
        case other:
            raise SimulatorEnded(f"it answered {other.kind!r} to a replay", None, "", killed="limit")


class Replay(NamedTuple):
    """An episode simulated once more.

    Attributes:
        request: What it was asked for.
        world: Where.
        driven: What came of it this time.
    """

    request: EpisodeRequest
    world: World
    driven: ReplayResult


def replay(batch: OpenBatch, index: int, bundles: Mapping[str, Path], *, engine: str = "") -> Replay:
    """Returns an episode simulated once more: as its batch did it, with its lanes, world, seed and bundles.

    Args:
        batch: The batch.
        index: Which of its episodes.
        bundles: Unpacked folders of its applications, by digest.
        engine: What drove it, where that is known; else what the batch asked for.

    Raises:
        ResourceNotFound: Its world or its data are gone, or not what they were.
        SimulatorEnded: The process that simulates ended over it.
    """
    return replay_request(batch, batch.layout.request(index), bundles, engine=engine)


def replay_request(
    batch: OpenBatch, request: EpisodeRequest, bundles: Mapping[str, Path], *, engine: str = ""
) -> Replay:
    """Returns an episode like those of a batch, simulated once more as the batch would.

    Args:
        batch: The batch.
        request: The episode.
        bundles: Unpacked folders of its applications, by digest.
        engine: What drove it, where that is known; else what the batch asked for.

    Raises:
        ResourceNotFound: Its world or its data are gone, or not what they were.
        SimulatorEnded: The process that simulates ended over it.
    """
    worlds, missing = load_worlds(batch, [request])
    mounted = batch_mounts(batch)
    if why := missing.get(request.world) or mounted.failure(request):
        raise ResourceNotFound.of(
            "simulation-job", f"{batch.id}/{request.index}", f"one that can be replayed: {why}", source="simyard"
        )
    driven = drive_apart(
        mounted.resolved(request),
        worlds,
        bundles,
        lanes=batch.plan.lanes,
        engine=engine or batch.plan.engine,
        rate_hz=batch.plan.recordings.rateHz,
        beside=[mounted.resolved(each) for each in batch.layout.whole([request]) if each.index != request.index],
    )
    return Replay(request, worlds[request.world], driven)


def resimulate(
    batch: OpenBatch, requests: Sequence[EpisodeRequest], simulate: Simulate, lanes: int = 0
) -> list[EpisodeResult]:
    """Returns the results of some episodes, simulated again; a lane's do not depend on those beside it.

    But for robots that share its world, which are simulated with it.

    Args:
        batch: The batch.
        requests: Some of its episodes, or others like them, in any order.
        simulate: Simulates a part of a chunk.
        lanes: How many at a time; the batch's, if left out.
    """
    lanes, asked_for = lanes or batch.plan.lanes, requests
    requests = batch.layout.whole(requests) if batch.plan.robots else requests
    worlds, missing = load_worlds(batch, requests)
    mounted = batch_mounts(batch)
    why_not = {each.index: missing.get(each.world) or mounted.failure(each) for each in requests}
    rows = {index: failed_result(index, failure) for index, failure in why_not.items() if failure}
    watch = StopWatch(batch, [each.index for each in requests], inf)

    sound = [mounted.resolved(each) for each in requests if each.index not in rows]
    chunks = [PreparedChunk(each, each, worlds, {}) for each in plan_chunks(sound, lanes)]

    def part(coming: Sequence[PreparedChunk], whole: Chunk, chunk: Chunk, lanes: int) -> Results:
        return simulate(ChunkPart(chunk, worlds, lanes, watch, None, chunk.requests == whole.requests, coming=coming))

    for number, chunk in enumerate(chunks):
        coming = [chunks[each] for each in chunks_ahead(range(number + 1, len(chunks)))]
        simulate_part = functools.partial(part, coming, chunk.able)
        found = retry_with_fewer_lanes(chunk.able, lanes, simulate_part, lambda: False).rows
        rows |= {row.index: row for row in found}
    return [rows[each.index] for each in asked_for]
