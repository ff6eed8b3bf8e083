"""Conditions of ``launch``: whether an action is done."""

from tasks.ros.ros2.launch_file.stand_in.context import LaunchContext, text_of, truth_of


class IfCondition:
    """Holds if a text is true."""

    def __init__(self, predicate_expression: object) -> None:
        self._text = predicate_expression

    def evaluate(self, context: LaunchContext) -> bool:
        """Returns whether it holds."""
        return truth_of(text_of(context, self._text))


class UnlessCondition(IfCondition):
    """Holds if a text is false."""

    def evaluate(self, context: LaunchContext) -> bool:
        """Returns whether it holds."""
        return not super().evaluate(context)


class LaunchConfigurationEquals(IfCondition):
    """Holds if a launch configuration has a value; None for one that is not set."""

    def __init__(self, launch_configuration_name: str, expected_value: object) -> None:
        self._name, self._expected = launch_configuration_name, expected_value

    def evaluate(self, context: LaunchContext) -> bool:
        """Returns whether it holds."""
        expected = None if self._expected is None else text_of(context, self._expected)
        return context.launch_configurations.get(self._name) == expected


class LaunchConfigurationNotEquals(LaunchConfigurationEquals):
    """Holds if a launch configuration has another value."""

    def evaluate(self, context: LaunchContext) -> bool:
        """Returns whether it holds."""
        return not super().evaluate(context)
