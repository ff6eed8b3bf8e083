"""The end of a roll-out: its status, failure code and reason for the job's record."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from specs.robomaker.failure_codes import DeploymentJobErrorCode
from tasks.deploy.fleet.states import RobotProgress
from tasks.deploy.rollout.observation import phase_of
from tasks.deploy.rollout.rollout_plan import RolloutPlan
from tasks.deploy.rollout.waves import Move, Phase

_NAMED = 5
_WHY: Mapping[str, str] = {
    "canary": "a canary failed",
    "time": "the fleet's time was over",
    "canceled": "canceled on request",
}


@dataclass(frozen=True)
class RolloutEnd:
    """Attributes: status, failure_code, failure_reason: As RoboMaker has them; empty for a success."""

    status: str
    failure_code: DeploymentJobErrorCode | Literal[""] = ""
    failure_reason: str = ""


def rollout_end(plan: RolloutPlan, move: Move, seen: Mapping[str, RobotProgress]) -> RolloutEnd:
    """Returns how a roll-out ended.

    Args:
        plan: What it was to do.
        move: The last one, which has a verdict.
        seen: How far the robots are.
    """
    if move.verdict == "Succeeded":
        return RolloutEnd("Succeeded")
    if move.verdict == "Canceled":
        return RolloutEnd("Canceled", failure_reason=_left_out(_WHY["canceled"], seen))
    code: DeploymentJobErrorCode = "FleetDeploymentTimeout" if move.why == "time" else "FailureThresholdBreached"
    return RolloutEnd("Failed", code, _left_out(_failures(plan, move, seen), seen))


def _failures(plan: RolloutPlan, move: Move, seen: Mapping[str, RobotProgress]) -> str:
    failed = {robot: each for robot, each in seen.items() if phase_of(each) is Phase.FAILED}
    names = ", ".join(f"{robot}: {each.failure_code}" for robot, each in list(failed.items())[:_NAMED])
    why = next((f"; {robot}: {each.failure_reason}" for robot, each in failed.items() if each.failure_reason), "")
    what = f"{len(failed)} of {len(seen)} robots failed" + (f" ({names})" if names else "")
    if move.why in _WHY:
        return f"{_WHY[move.why]}; {what}{why}"
    return f"{what}, and {plan.failures} stop the roll-out{why}"


def _left_out(reason: str, seen: Mapping[str, RobotProgress]) -> str:
    aborted = sum(phase_of(each) is Phase.ABORTED for each in seen.values())
    left = "1 was left as it was" if aborted == 1 else f"{aborted} were left as they were"
    return reason + (f"; {left}" if aborted else "")
