#!/usr/bin/env python3
"""Behaves for some scans, and then does one thing that a node should not do: ~kind says which."""

import os
import signal
import socket
import subprocess
import threading
import time

import rospy
from geometry_msgs.msg import Twist
from sensor_msgs.msg import LaserScan

rospy.init_node("fault")
kind = rospy.get_param("~kind")
commands = rospy.Publisher("/cmd_vel", Twist, queue_size=1)
scans = [0]


def flood():
    while not rospy.is_shutdown():
        commands.publish(Twist())
        time.sleep(0.0005)


def sockets():
    for name in os.listdir("/proc/self/fd"):
        try:
            if os.readlink("/proc/self/fd/" + name).startswith("socket"):
                os.close(int(name))
        except OSError:
            pass


def misbehave(command):
    if kind == "crash":
        os._exit(7)
    elif kind == "done":
        rospy.signal_shutdown("done")
    elif kind == "hang":
        while True:
            pass
    elif kind == "stop":
        os.kill(os.getpid(), signal.SIGSTOP)
    elif kind == "nan":
        command.linear.x = float("nan")
    elif kind == "nap":
        time.sleep(0.02)
    elif kind == "sockets":
        sockets()
    elif kind == "memory":
        scans.append([bytearray(1 << 20) for _ in range(500)])
    elif kind == "files":
        with open(os.path.join(os.environ["ROS_HOME"], "much-" + str(scans[0])), "wb") as file:
            file.write(bytes(range(256)) * 40000)
    elif kind == "forks":
        for _ in range(10):
            subprocess.Popen(["sleep", "600"])


def hear(scan):
    scans[0] += 1
    command = Twist()
    command.linear.x = 0.2
    if scans[0] > 15:
        misbehave(command)
    commands.publish(command)


rospy.Subscriber("/scan", LaserScan, hear, queue_size=1)
if kind == "flood":
    threading.Thread(target=flood, daemon=True).start()
if kind == "port":
    kept = socket.create_server(("0.0.0.0", 8080))
if kind == "orphan":
    subprocess.Popen("setsid sleep 600 & exit", shell=True, start_new_session=True)
rospy.spin()
