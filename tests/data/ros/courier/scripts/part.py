#!/usr/bin/env python3
"""One node of a graph: hands on what it reads, once it slept and asked, and turns by a timer; ~does says how."""

import json
import math
import time

import rospy
from geometry_msgs.msg import Twist
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Trigger, TriggerResponse

rospy.init_node("part")
does = json.loads(rospy.get_param("~does"))
turn, calls = [0.0], [0]


def hear(message):
    twist = Twist() if does["reads"] == "scan" else message
    if does["reads"] == "scan":
        twist.linear.x = 0.2 * min(1.0, *message.ranges)
    twist.angular.z += turn[0]
    time.sleep(does["sleep_s"])
    if asked is not None:
        twist.angular.z += 0.01 * (int(asked().message) % 7)
    commands.publish(twist)


def steer(event):
    turn[0] = 0.1 * math.cos(rospy.get_time())


def answer(request):
    calls[0] += 1
    time.sleep(does["sleep_s"])
    return TriggerResponse(success=True, message=str(calls[0]))


if does["answers"]:
    rospy.Service(does["answers"], Trigger, answer)
asked = None
if does["asks"]:
    rospy.wait_for_service(does["asks"])
    asked = rospy.ServiceProxy(does["asks"], Trigger, persistent=does["threads"])
if does["reads"]:
    commands = rospy.Publisher(does["writes"], Twist, queue_size=10)
    rospy.Subscriber(does["reads"], LaserScan if does["reads"] == "scan" else Twist, hear, queue_size=10)
if does["timer_s"]:
    rospy.Timer(rospy.Duration(does["timer_s"]), steer)
rospy.spin()
