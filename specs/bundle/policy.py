"""The file ``<launch>.yaml`` beside a policy ``<launch>.onnx``: what it is shown, and what its answer means."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from specs.base import Spec
from specs.bundle.sensors import BumperDeclaration, LidarDeclaration, OdometryDeclaration

PolicyField = Literal[
    "ranges_m", "goal_robot_m", "goal_m", "goal_index", "pose", "velocity", "bumper", "time_s", "qpos", "qvel"
]
Name = Annotated[str, Field(min_length=1, max_length=255)]
Number = Annotated[float, Field(ge=-1e9, le=1e9)]


class PolicyPart(Spec):
    """A field of the observation, as a policy is shown it: ``clip(field * scale + offset, low, high)``.

    Attributes:
        field: Its name (docs/guide/applications.md); ``qpos`` and ``qvel`` are those of ``joints``.
        scale, offset: What it is multiplied with, and what is added then.
        low, high: Between which the result is held; None for no bound.
    """

    field: PolicyField
    scale: Number = 1.0
    offset: Number = 0.0
    low: Number | None = None
    high: Number | None = None

    @model_validator(mode="after")
    def _bounds_in_order(self) -> Self:
        if self.low is not None and self.high is not None and self.low > self.high:
            raise ValueError(f"low {self.low} is above high {self.high}")
        return self


class PolicyInput(Spec):
    """An input of the network: some parts, one after the other.

    Attributes:
        name: Of the input; None for the only one that is not kept.
        parts: In their order.
    """

    name: Name | None = None
    parts: Annotated[tuple[PolicyPart, ...], Field(min_length=1, max_length=64)]


class PolicyState(Spec):
    """What a recurrent network keeps, for each lane: the output of one control step is the input of the next.

    It begins with zeros. Its dimension of the lanes is the one that the network leaves open.

    Attributes:
        input, output: Their names.
    """

    input: Name
    output: Name


class ActionOutput(Spec):
    """The answer is an action from -1 to 1, clipped, over the ``ctrlrange`` of each actuator that has one.

    Attributes:
        name: Of the output; None for the only one that is not kept.
    """

    kind: Literal["action"] = "action"
    name: Name | None = None


class ControlsOutput(Spec):
    """The answer is the control itself: one number for each actuator, or for each that has a ``ctrlrange``.

    Attributes:
        name: Of the output; None for the only one that is not kept.
    """

    kind: Literal["controls"]
    name: Name | None = None


class ChoiceOutput(Spec):
    """The answer is a score for each of some controls: the highest is taken, the first of equals.

    Attributes:
        name: Of the output; None for the only one that is not kept.
        controls: One number for each actuator, or for each that has a ``ctrlrange``.
    """

    kind: Literal["choice"]
    name: Name | None = None
    controls: Annotated[
        tuple[Annotated[tuple[Number, ...], Field(min_length=1, max_length=256)], ...],
        Field(min_length=1, max_length=4096),
    ]


PolicyOutput = Annotated[ActionOutput | ControlsOutput | ChoiceOutput, Field(discriminator="kind")]


class Policy(Spec):
    """A network that drives a robot.

    Attributes:
        lidar, odometry, bumper: The robot's sensors; None for a robot without.
        inputs: What the network is shown.
        states: What it keeps.
        output: What its answer means.
    """

    lidar: LidarDeclaration | None = None
    odometry: OdometryDeclaration | None = None
    bumper: BumperDeclaration | None = None
    inputs: Annotated[tuple[PolicyInput, ...], Field(min_length=1, max_length=64)]
    states: Annotated[tuple[PolicyState, ...], Field(max_length=64)] = ()
    output: PolicyOutput = ActionOutput()
