"""Nodes of rclpy, each with something that makes its order of events its own affair."""

import math
import time

import rclpy
from ament_index_python.packages import get_package_share_directory
from geometry_msgs.msg import Twist, TwistStamped
from rclpy.action import ActionClient, ActionServer
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan
from test_msgs.action import Fibonacci


class Driver(Node):
    """Answers each scan with a command that depends on all scans before."""

    def __init__(self, name, kind=Twist):
        super().__init__(name)
        assert get_package_share_directory("trials"), "a package that is not built is found"
        self.declare_parameter("speed", 0.2)
        self.scans = 0
        self.commands = self.create_publisher(kind, "cmd_vel", 10)
        own = MutuallyExclusiveCallbackGroup()
        self.create_subscription(LaserScan, "scan", self.on_scan, qos_profile_sensor_data, callback_group=own)

    def on_scan(self, scan):
        self.scans += 1
        twist = Twist()
        twist.linear.x = self.get_parameter("speed").value * min(1.0, *scan.ranges)
        twist.angular.z = 0.3 * math.sin(self.scans / 7)
        self.publish(twist)

    def publish(self, twist):
        self.commands.publish(twist)


class Threads(Driver):
    """A timer in a thread of its own, and a callback that sleeps by the wall's clock."""

    def __init__(self):
        super().__init__("threads")
        self.turn = 0.0
        self.create_timer(0.1, self.on_timer, callback_group=MutuallyExclusiveCallbackGroup())

    def on_timer(self):
        self.turn = 0.1 * math.cos(self.get_clock().now().nanoseconds * 1e-9)

    def publish(self, twist):
        time.sleep(0.01)
        twist.angular.z += self.turn
        super().publish(twist)


class Stamped(Driver):
    """Commands with a time and a frame, as Jazzy's controllers take them."""

    def __init__(self):
        super().__init__("stamped", TwistStamped)

    def publish(self, twist):
        message = TwistStamped(twist=twist)
        message.header.stamp, message.header.frame_id = self.get_clock().now().to_msg(), "base_link"
        super().publish(message)


class Counter(Driver):
    """Takes its speed from how far it has been asked to count, by an action."""

    def __init__(self):
        super().__init__("counter")
        self.server = ActionServer(self, Fibonacci, "count", self.on_goal, callback_group=ReentrantCallbackGroup())

    async def on_goal(self, goal):
        found = [0, 1]
        for _ in range(goal.request.order):
            found.append(found[-1] + found[-2])
            goal.publish_feedback(Fibonacci.Feedback(sequence=found))
        self.set_parameters([Parameter("speed", value=0.05 + 0.01 * (found[-1] % 10))])
        goal.succeed()
        return Fibonacci.Result(sequence=found)


class Asker(Node):
    """Asks for more each time, once it has an answer."""

    def __init__(self):
        super().__init__("asker")
        self.client, self.order = ActionClient(self, Fibonacci, "count"), 1
        self.create_timer(0.25, self.on_timer)

    def on_timer(self):
        sent = self.client.send_goal_async(Fibonacci.Goal(order=self.order))
        sent.add_done_callback(lambda goal: goal.result().get_result_async().add_done_callback(self.on_result))

    def on_result(self, result):
        self.order += len(result.result().result.sequence) % 3


def _spin(kind, executor):
    rclpy.init()
    executor = executor()
    executor.add_node(kind())
    executor.spin()


def threads():
    _spin(Threads, MultiThreadedExecutor)


def stamped():
    _spin(Stamped, SingleThreadedExecutor)


def counter():
    _spin(Counter, SingleThreadedExecutor)


def asker():
    _spin(Asker, SingleThreadedExecutor)
