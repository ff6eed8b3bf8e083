#!/usr/bin/env python3
"""Judges the robot once it has gone far enough, or once the time for that is over, in the way that HOW says."""

import os
import sys

import rospy
from nav_msgs.msg import Odometry
from robomaker_simulation_msgs.msg import Tag
from robomaker_simulation_msgs.srv import AddTags, Cancel

HOW = os.environ.get("HOW", "tags")
FAR_M, LIMIT_S = float(os.environ.get("FAR", "0.3")), float(os.environ.get("LIMIT", "60"))
JUNIT = '<testsuite tests="1" failures="{0}"><testcase name="drives">{1}</testcase></testsuite>\n'


class Examiner:
    def __init__(self):
        self.verdict, self.start = None, None
        rospy.Subscriber("/odom", Odometry, self.look, queue_size=1)

    def look(self, odometry):
        place = odometry.pose.pose.position
        self.start = self.start or place
        gone_m = ((place.x - self.start.x) ** 2 + (place.y - self.start.y) ** 2) ** 0.5
        now_s = odometry.header.stamp.to_sec()
        if self.verdict is None and (gone_m >= FAR_M or now_s >= LIMIT_S):
            self.verdict = gone_m >= FAR_M
            self.say(gone_m, now_s)

    def say(self, gone_m, now_s):
        sys.stdout.write("gone %.3f m after %.2f s\n" % (gone_m, now_s))
        if HOW in ("tags", "cancel"):
            tags = [Tag(key="Distance", value="%.3f" % gone_m)]
            if HOW == "tags":
                tags.append(Tag(key="drives_Status", value="Passed" if self.verdict else "Failed"))
            rospy.ServiceProxy("/robomaker/job/add_tags", AddTags)(tags)
            rospy.ServiceProxy("/robomaker/job/cancel", Cancel)()
        elif HOW != "nothing":
            rospy.signal_shutdown("judged")


def main():
    rospy.init_node("examine")
    examiner = Examiner()
    rospy.spin()
    for word in sys.argv:
        if word.startswith("--gtest_output=xml:"):
            with open(word.partition("xml:")[2], "w") as file:
                file.write(JUNIT.format(int(not examiner.verdict), "" if examiner.verdict else "<failure/>"))
    if HOW == "exit":
        sys.exit(0 if examiner.verdict else 3)


main()
