"""A replay in the process that simulates: the episode goes there, its row and all its steps come back."""

from collections.abc import Mapping
from pathlib import Path

from specs.data.episode import EpisodeRequest, Failure, failed_result
from specs.data.world import World
from tasks.simulate.application.code import crash_code
from tasks.simulate.process.simulator import Simulator, SimulatorEnded
from tasks.simulate.process.simulators import ask_beside_nothing
from tasks.simulate.process.work import Again, AgainWork, Crashed, NoMemory
from tasks.simulate.replay.driven_again import DrivenAgain
from tasks.simulate.replay.sent_replay import again_of


def drive_apart(
    request: EpisodeRequest,
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str,
    rate_hz: float,
) -> DrivenAgain:
    """Returns an episode driven to its end, as ``replay_drive.drive_again``, which takes the same.

    Raises:
        MemoryError: There is not enough memory for so many lanes.
        SimulatorEnded: The process ended, but for in an application's code: such an episode has its row.
    """

    def question(process: Simulator) -> AgainWork:
        return AgainWork(
            request=request,
            worlds=process.sent_worlds({request.world: worlds[request.world]}),
            bundles={digest: str(folder) for digest, folder in bundles.items()},
            lanes=lanes,
            engine=engine,
            rate_hz=rate_hz,
        )

    try:
        answer, arrays = ask_beside_nothing(bundles, question)
    except SimulatorEnded as ended:
        if ended.out_of_memory:
            raise
        return DrivenAgain(failed_result(request.index, Failure(crash_code(ended.code), ended.reason)))
    match answer:
        case Again() as again:
            return again_of(again, arrays)
        case Crashed() as crashed:
            return DrivenAgain(failed_result(request.index, Failure(crashed.code, crashed.reason)))
        case NoMemory() as lack:
            raise MemoryError(lack.text)
        case other:
            raise SimulatorEnded(f"it answered {other.kind!r} to a replay", None, "", killed="limit")
