"""Nodes of rclpy, each with something that makes its order of events its own affair."""

import ctypes
import json
import math
import os
import signal
import struct
import subprocess
import threading
import time

import rclpy
from ament_index_python.packages import get_package_share_directory
from geometry_msgs.msg import Twist, TwistStamped, Vector3
from rclpy.action import ActionClient, ActionServer
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, Image, Imu, LaserScan, PointCloud2, Range
from std_srvs.srv import Trigger
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


class Faulty(Driver):
    """Drives for forty scans, and then does what it should not: $FAULT says what."""

    def publish(self, twist):
        super().publish(twist)
        if self.scans == 40:
            FAULTS[os.environ["FAULT"]]()


def hang():
    while True:
        pass


def leave_a_child():
    subprocess.Popen(["setsid", "sleep", "600"], start_new_session=True)
    os._exit(3)


FAULTS = {
    "raise": lambda: 1 // 0,
    "exit": lambda: os._exit(7),
    "done": lambda: os._exit(0),
    "hang": hang,
    "kill": lambda: os.kill(os.getpid(), signal.SIGKILL),
    "abort": os.abort,
    "stop": lambda: os.kill(os.getpid(), signal.SIGSTOP),
    "child": leave_a_child,
}


class Stamped(Driver):
    """Commands with a time and a frame, as Jazzy's controllers take them."""

    def __init__(self):
        super().__init__("stamped", TwistStamped)

    def publish(self, twist):
        message = TwistStamped(twist=twist)
        message.header.stamp, message.header.frame_id = self.get_clock().now().to_msg(), "base_link"
        super().publish(message)


class Seer(Node):
    """Drives to where its pictures of depth are farthest, and a little by all else that it is shown."""

    def __init__(self):
        super().__init__("seer")
        self.told = {}
        self.commands = self.create_publisher(Twist, "cmd_vel", 10)
        self.hear(Image, "camera/color/image_raw", lambda each: each.data[0] + each.data[-1])
        self.hear(CameraInfo, "camera/depth/camera_info", lambda each: each.k[2])
        self.hear(PointCloud2, "camera/depth/points", lambda each: len(each.data))
        self.hear(Range, "range_1", lambda each: min(each.range, 9.0) + each.variance)
        self.hear(Imu, "imu", lambda each: each.angular_velocity.x)
        self.create_subscription(Image, "camera/depth/image_raw", self.on_depth, qos_profile_sensor_data)

    def hear(self, kind, topic, value):
        def keep(message):
            count, total = self.told.get(topic, (0, 0.0))
            self.told[topic] = count + 1, total + value(message)

        self.create_subscription(kind, topic, keep, qos_profile_sensor_data)

    def on_depth(self, picture):
        columns = picture.width
        middle = struct.unpack_from(f"<{columns}f", picture.data, picture.step * (picture.height // 2))
        left, right = (
            sum(min(each, 9.0) for each in half) for half in (middle[: columns // 2], middle[columns // 2 :])
        )
        twist = Twist()
        twist.linear.x = min(0.3, min(middle) / 4.0)
        twist.angular.z = 0.5 * (left - right) / (left + right)
        twist.angular.z += sum(0.001 * (count % 7) + 1e-6 * total for count, total in self.told.values())
        self.commands.publish(twist)


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


class Part(Node):
    """One node of a graph: hands on what it reads, once it slept and asked, and turns by a timer."""

    def __init__(self):
        super().__init__("part")
        self.does, self.turn, self.asked = json.loads(os.environ["GRAPH"])[self.get_name()], 0.0, None
        group = ReentrantCallbackGroup()
        if self.does["reads"]:
            kind = LaserScan if self.does["reads"] == "scan" else Twist
            self.commands = self.create_publisher(Twist, self.does["writes"], 10)
            self.create_subscription(kind, self.does["reads"], self.on_message, 10, callback_group=group)
        if self.does["timer_s"]:
            self.create_timer(self.does["timer_s"], self.on_timer, callback_group=group)
        if self.does["asks"]:
            self.asked = self.create_client(Trigger, self.does["asks"], callback_group=group)
        if self.does["answers"]:
            self.calls = 0
            self.create_service(Trigger, self.does["answers"], self.on_request, callback_group=group)

    def on_message(self, message):
        twist = Twist() if isinstance(message, LaserScan) else message
        if isinstance(message, LaserScan):
            twist.linear.x = 0.2 * min(1.0, *message.ranges)
        twist.angular.z += self.turn
        time.sleep(self.does["sleep_s"])
        if self.asked is None:
            self.commands.publish(twist)
        else:
            self.asked.call_async(Trigger.Request()).add_done_callback(
                lambda done: self.on_answer(twist, done.result())
            )

    def on_answer(self, twist, answer):
        twist.angular.z += 0.01 * (int(answer.message) % 7)
        self.commands.publish(twist)

    def on_timer(self):
        self.turn = 0.1 * math.cos(self.get_clock().now().nanoseconds * 1e-9)

    def on_request(self, _, response):
        self.calls += 1
        time.sleep(self.does["sleep_s"])
        response.message = str(self.calls)
        return response


class WallTimer(Driver):
    """Commands by a timer of the steady clock, as ``create_wall_timer`` of rclcpp makes one."""

    def __init__(self):
        ctypes.CDLL("librclcpp.so")  # what stands for it, and by which the process is known
        super().__init__("walltimer")
        self.turn = 0.0
        self.create_timer(0.02, self.on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def on_timer(self):
        self.turn += 0.001
        twist = Twist()
        twist.linear.x, twist.angular.z = 0.1, self.turn + 0.1 * math.sin(self.scans / 7)
        self.commands.publish(twist)

    def publish(self, twist):
        pass


class Turns(Driver):
    """Two threads sleep until the same tick, as C++ does it: what one of them counts, the other one commands."""

    def __init__(self):
        self.library = ctypes.CDLL("librclcpp.so")
        super().__init__("turns")
        self.counted, self.libc, self.threads = 0, ctypes.CDLL(None), []

    def publish(self, _):
        if not self.threads:
            self.threads = [threading.Thread(target=each, daemon=True) for each in (self.command, self.count)]
            for each in self.threads:
                each.start()

    def count(self):
        while True:
            self.libc.usleep(40_000)
            self.counted += 1

    def command(self):
        while True:
            self.libc.usleep(40_000)
            self.commands.publish(Twist(angular=Vector3(z=0.01 * self.counted)))


def _spin(kind, executor):
    rclpy.init()
    executor = executor()
    executor.add_node(kind())
    executor.spin()


def part():
    rclpy.init()
    node = Part()
    executor = MultiThreadedExecutor() if node.does["threads"] else SingleThreadedExecutor()
    executor.add_node(node)
    executor.spin()


def threads():
    _spin(Threads, MultiThreadedExecutor)


def faulty():
    _spin(lambda: Faulty("faulty"), MultiThreadedExecutor)


def stamped():
    _spin(Stamped, SingleThreadedExecutor)


def walltimer():
    _spin(WallTimer, SingleThreadedExecutor)


def turns():
    _spin(Turns, SingleThreadedExecutor)


def looker():
    """Commands each time that it has looked for messages for so long at most."""
    ctypes.CDLL("librclcpp.so")
    rclpy.init()
    node, turn = Driver("looker"), 0.0
    node.publish = lambda _: None
    while rclpy.ok():
        rclpy.spin_once(node, timeout_sec=0.03)
        turn += 0.001
        node.commands.publish(Twist(angular=Vector3(z=turn + 0.01 * node.scans)))


def seer():
    _spin(Seer, SingleThreadedExecutor)


def counter():
    _spin(Counter, SingleThreadedExecutor)


def asker():
    _spin(Asker, SingleThreadedExecutor)
