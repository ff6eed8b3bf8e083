"""The table of controllers that run on the host, one record each: how an application of that kind is loaded."""
# ruff: noqa: PLC0415 - what a kind needs is imported when an application of that kind is loaded

from collections.abc import Callable, Mapping

from tasks.simulate.host.controller_kind import ControllerKind
from tasks.simulate.host.controllers import HostApplication, HostBundle


def _plain(bundle: HostBundle) -> HostApplication:
    from tasks.simulate.host.plain_python import plain_application

    return plain_application(bundle)


def _batched(bundle: HostBundle) -> HostApplication:
    from tasks.simulate.host.batched_python import batched_application

    return batched_application(bundle)


def _onnx(bundle: HostBundle) -> HostApplication:
    from tasks.simulate.host.policy.onnx_policy import onnx_application

    return onnx_application(bundle)


def _ros(bundle: HostBundle) -> HostApplication:
    from tasks.simulate.host.ros_application import ros1_lockstep, ros_application

    return ros_application(bundle, "ros", ros1_lockstep)


def _ros2(bundle: HostBundle) -> HostApplication:
    from tasks.simulate.host.ros_application import ros2_lockstep, ros_application

    return ros_application(bundle, "ros2", ros2_lockstep)


HOST_KINDS: Mapping[ControllerKind, Callable[[HostBundle], HostApplication]] = {
    "plain": _plain,
    "batched": _batched,
    "onnx": _onnx,
    "ros": _ros,
    "ros2": _ros2,
}
