"""Simulates episodes of a batch again, together, as its chunks were simulated."""

from collections.abc import Sequence
from math import inf

from specs.data.episode import EpisodeRequest, EpisodeResult, failed_result
from tasks.simulate.batch.commit import ChunkPart, Simulate
from tasks.simulate.batch.job import OpenBatch
from tasks.simulate.batch.prepared_chunks import batch_mounts, load_worlds
from tasks.simulate.batch.stop import StopWatch
from tasks.simulate.chunk.memory_fit import Results, simulate_fitting
from tasks.simulate.plan.chunks import Chunk, plan_chunks, program_key


def resimulate(batch: OpenBatch, requests: Sequence[EpisodeRequest], simulate: Simulate) -> list[EpisodeResult]:
    """Returns the results of some episodes, simulated again; a lane's do not depend on those beside it.

    Args:
        batch: The batch.
        requests: Some of its episodes, in any order.
        simulate: Simulates a part of a chunk.
    """
    worlds, missing = load_worlds(batch, requests)
    mounted = batch_mounts(batch)
    why_not = {each.index: missing.get(each.world) or mounted.failure(each) for each in requests}
    rows = {index: failed_result(index, failure) for index, failure in why_not.items() if failure}
    watch = StopWatch(batch, [each.index for each in requests], inf)

    def part(chunk: Chunk, lanes: int) -> Results:
        asked = tuple(mounted.resolved(each) for each in chunk.requests)
        program = program_key(chunk.requests[0])
        return simulate(ChunkPart(chunk.model_copy(update={"requests": asked}), worlds, lanes, watch, None, program))

    for chunk in plan_chunks([each for each in requests if each.index not in rows], batch.plan.lanes):
        found = simulate_fitting(chunk, batch.plan.lanes, part, lambda: False).rows
        rows |= {row.index: row for row in found}
    return [rows[each.index] for each in requests]
