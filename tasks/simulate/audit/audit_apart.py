"""An audit in the process that simulates: the sample goes there, the report comes back."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from specs.data.world import World
from tasks.simulate.application.code import BundleCrash, crash_code
from tasks.simulate.audit.audit_report import AuditReport
from tasks.simulate.audit.audit_sample import SampledEpisode
from tasks.simulate.process.simulator import Simulator, SimulatorEnded
from tasks.simulate.process.simulators import ask_beside_nothing
from tasks.simulate.process.work import Answer, Audited, AuditedEpisode, AuditWork, Crashed, NoMemory, Progress


def audit_apart(
    sample: Sequence[SampledEpisode],
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str = "auto",
    drawn: int = 0,
    progress: Callable[[int], None] = lambda _: None,
) -> AuditReport:
    """Returns what driving a sample again shows, as ``audit_drive.audit``, which takes the same.

    Raises:
        BundleCrash: An application that made rows before now fails.
        MemoryError: There is not enough memory for so many lanes.
        SimulatorEnded: The process ended over it.
        ValidationError: It answered with no report.
    """

    def hear(answer: Answer, _: tuple[np.ndarray, ...]) -> None:
        if isinstance(answer, Progress):
            progress(answer.done)

    def question(process: Simulator) -> AuditWork:
        used = dict.fromkeys(each.request.world for each in sample)
        return AuditWork(
            sample=tuple(AuditedEpisode(request=each.request, row=each.row, weight=each.weight) for each in sample),
            worlds=process.sent_worlds({name: worlds[name] for name in used}),
            bundles={digest: str(folder) for digest, folder in bundles.items()},
            lanes=lanes,
            engine=engine,
            drawn=drawn,
        )

    last, _ = ask_beside_nothing(bundles, question, hear)
    match last:
        case Audited() as audited:
            return AuditReport.model_validate_json(audited.report)
        case Crashed() as crashed:
            raise BundleCrash(crash_code(crashed.code), crashed.reason)
        case NoMemory() as lack:
            raise MemoryError(lack.text)
        case other:
            raise SimulatorEnded(f"it answered {other.kind!r} to an audit", None, "", killed="limit")
