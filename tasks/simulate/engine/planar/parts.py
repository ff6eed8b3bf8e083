"""A planar base as numbers: the hull's discs, the motors, the joints' dry friction, and the masses they move."""

from dataclasses import dataclass

from tasks.simulate.application.robot_mjcf import Hull


@dataclass(frozen=True)
class Softness:
    """How a constraint row gives way (MuJoCo documentation, "Solver parameters").

    Attributes:
        stiffness: MuJoCo's k (1/s2).
        damping: MuJoCo's b (1/s).
        inverse_mass: What (1 - d) / d is multiplied with to give the regularizer R, d being the impedance.
        impedance: (d at the margin, d at full width, width in metres, midpoint, power).
    """

    stiffness: float
    damping: float
    inverse_mass: float
    impedance: tuple[float, float, float, float, float]


@dataclass(frozen=True)
class Disc:
    """A sphere, or an upright capsule or cylinder of the hull: a disc, seen from above.

    Attributes:
        forward_m, left_m: Its axis in the base's frame.
        height_m: Of its middle above the floor.
        half_length_m: Of a capsule's or cylinder's straight part; 0 for a sphere.
        capsule: Whether boxes touch it as MuJoCo's capsules.
        flat: Whether its ends are level, as a cylinder's.
        upturned: Whether a capsule's own axis points down.
        friction: Sliding friction coefficient, or None where contacts are frictionless (condim 1).
        margin_m: Distance below which a contact pushes.
    """

    forward_m: float
    left_m: float
    height_m: float
    radius_m: float
    half_length_m: float
    capsule: bool
    flat: bool
    upturned: bool
    friction: float | None
    margin_m: float
    softness: Softness


@dataclass(frozen=True)
class Motor:
    """An actuator: what its control becomes, and where its force acts.

    Attributes:
        moment: Forces along x and y and torque about the yaw axis for a force of 1, the base unturned.
        turns: Whether the force turns with the base (a site's) or stays with the world's axes (a joint's).
        length: The actuator's length for coordinates of 1.
        control_range, force_range: Limits, or None.
        gain, bias: (constant, per length, per velocity).
        activation: Its place among the activations, or None for an actuator without dynamics.
        time_constant_s: Of a filter; None for an integrator.
        exact_filter: Whether the filter is integrated exactly.
        activation_range: Limits of the activation, or None.
        early: Whether the force already feels the next activation.
    """

    moment: tuple[float, float, float]
    turns: bool
    length: tuple[float, float, float]
    control_range: tuple[float, float] | None
    force_range: tuple[float, float] | None
    gain: tuple[float, float, float]
    bias: tuple[float, float, float]
    activation: int | None
    time_constant_s: float | None
    exact_filter: bool
    activation_range: tuple[float, float] | None
    early: bool


@dataclass(frozen=True)
class DryFriction:
    """The friction loss of a joint: at most ``limit`` (N or N m), linear in the slip near rest."""

    axis: int
    limit: float
    damping: float
    weight: float


@dataclass(frozen=True, eq=False)
class PlanarRobot:
    """A robot as the planar engine steps it.

    Attributes:
        masses: What an acceleration along x, along y and about the yaw axis has to move (kg, kg, kg m2), armature
            included.
        lever: Mass times the place of its centre in the base's frame (kg m).
        damping: Of the joints (N s/m, N s/m, N m s).
        rest_activations: Of the actuators, at the start.
        implicit_damping: Whether the integrator treats the joints' damping implicitly.
        implicit_motors: Whether it treats the actuators' damping so too (implicitfast).
        uncoupled: Whether MuJoCo stores the mass matrix as a diagonal, the centre of mass being on the yaw axis; it
            then leaves out what couples the axes of the actuators' damping.
        joint_force_ranges: Limits on what the actuators of a joint do together, or None.
        physics_steps: In one control step.
    """

    hull: Hull
    discs: tuple[Disc, ...]
    motors: tuple[Motor, ...]
    dry_frictions: tuple[DryFriction, ...]
    masses: tuple[float, float, float]
    lever: tuple[float, float]
    damping: tuple[float, float, float]
    rest_activations: tuple[float, ...]
    implicit_damping: bool
    implicit_motors: bool
    uncoupled: bool
    joint_force_ranges: tuple[tuple[float, float] | None, ...]
    step_s: float
    physics_steps: int

    @property
    def actuators(self) -> int:
        """Returns how many numbers a control has."""
        return len(self.motors)
