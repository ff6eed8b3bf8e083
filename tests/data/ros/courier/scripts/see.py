#!/usr/bin/env python3
"""Drives to where its pictures of depth are farthest, and a little by all else that it is shown."""

import struct

import rospy
from geometry_msgs.msg import Twist
from sensor_msgs.msg import CameraInfo, Image, Imu, PointCloud2, Range

rospy.init_node("see")
commands = rospy.Publisher("/cmd_vel", Twist, queue_size=1)
told = {}


def keep(name, value):
    count, total = told.get(name, (0, 0.0))
    told[name] = count + 1, total + value


def on_depth(picture):
    rows, columns = picture.height, picture.width
    middle = struct.unpack_from("<%df" % columns, picture.data, picture.step * (rows // 2))
    left, right = (sum(min(each, 9.0) for each in half) for half in (middle[: columns // 2], middle[columns // 2 :]))
    assert picture.encoding == "32FC1"
    command = Twist()
    command.linear.x = min(0.3, min(middle) / 4.0)
    command.angular.z = 0.5 * (left - right) / (left + right)
    command.angular.z += sum(0.001 * (count % 7) + 1e-6 * total for count, total in told.values())
    commands.publish(command)


rospy.Subscriber("/camera/color/image_raw", Image, lambda each: keep("color", each.data[0] + each.data[-1]))
rospy.Subscriber("/camera/depth/camera_info", CameraInfo, lambda each: keep("info", each.K[2]))
rospy.Subscriber("/camera/depth/points", PointCloud2, lambda each: keep("points", len(each.data)))
rospy.Subscriber("/range_1", Range, lambda each: keep("range", min(each.range, 9.0)))
rospy.Subscriber("/imu", Imu, lambda each: keep("imu", each.angular_velocity.x))
rospy.Subscriber("/camera/depth/image_raw", Image, on_depth, queue_size=1, buff_size=1 << 22)
rospy.spin()
