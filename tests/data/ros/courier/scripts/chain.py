#!/usr/bin/env python3
"""Threads that poll, each for what the one before it found: the last one drives by the last scan."""

import threading
import time

import rospy
from geometry_msgs.msg import Twist
from sensor_msgs.msg import LaserScan

rospy.init_node("chain")
commands = rospy.Publisher("/cmd_vel", Twist, queue_size=1)
periods_s = [period_ms / 1000.0 for period_ms in rospy.get_param("~periods_ms")]
found = [0] * (len(periods_s) + 1)
nearest = [9.0]


def hear(scan):
    nearest[0] = min(scan.ranges)
    found[0] += 1


def poll(number, wait):
    while not rospy.is_shutdown():
        wait(periods_s[number])
        if found[number + 1] != found[number]:
            if number + 1 == len(periods_s):
                command = Twist()
                command.linear.x = min(0.3, nearest[0] / 4.0)
                command.angular.z = 0.7 if nearest[0] < 0.5 else 0.05
                commands.publish(command)
            found[number + 1] = found[number]


for number in range(len(periods_s)):
    wait = time.sleep if number % 2 else threading.Event().wait
    threading.Thread(target=poll, args=(number, wait), daemon=True).start()
rospy.Subscriber("/scan", LaserScan, hear, queue_size=1)
rospy.spin()
