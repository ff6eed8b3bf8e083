"""One control step of one lane: sense and decide, drive, settle. The program maps it over lanes."""

from tasks.simulate.applications import Applications
from tasks.simulate.judging import settle
from tasks.simulate.lane_state import LaneInputs, LaneState, Record
from tasks.simulate.mechanics import Mechanics
from tasks.simulate.sensing import decide


def advance_lane(
    mechanics: Mechanics, applications: Applications, inputs: LaneInputs, state: LaneState
) -> tuple[LaneState, Record]:
    """Returns a lane one control step later."""
    decided = decide(applications, inputs, state)
    motion = mechanics.drive(inputs, state.body, decided.control)
    return settle(applications, inputs, state, decided, motion)
