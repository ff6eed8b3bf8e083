"""What a batch would need, said before it runs and without importing JAX."""

from collections.abc import Sequence

from specs.base import Spec
from specs.episode import EpisodeRequest
from tasks.simulate.chunks import plan_chunks, program_key
from tasks.simulate.devices import device_count


class EnginePlan(Spec):
    """How a batch is going to be simulated.

    Attributes:
        devices: Host devices that share the lanes.
        lanes: Lanes of a chunk.
        chunks: Runs of compiled programs.
        compilations: Different programs; worlds, seeds and numeric variables add none.
        lane_steps_at_most: Physics steps of all lanes, if every episode took its full duration.
    """

    devices: int
    lanes: int
    chunks: int
    compilations: int
    lane_steps_at_most: int


_STEPS_A_SECOND = 200


def engine_plan(requests: Sequence[EpisodeRequest], lanes: int) -> EnginePlan:
    """Returns how the episodes of a batch would be simulated with that many lanes."""
    return EnginePlan(
        devices=device_count(),
        lanes=lanes,
        chunks=len(plan_chunks(requests, lanes)),
        compilations=len({program_key(request) for request in requests}),
        lane_steps_at_most=round(sum(request.duration_s for request in requests) * _STEPS_A_SECOND),
    )
