#!/usr/bin/env python3
"""Sets the robot elsewhere once it has gone a little, and back; tells its job's tags what Gazebo's services said."""

import os
import re

import rospy
from gazebo_msgs.msg import ModelState, ModelStates
from gazebo_msgs.srv import GetModelState, GetPhysicsProperties, SetModelState, SetPhysicsProperties
from robomaker_simulation_msgs.msg import Tag
from robomaker_simulation_msgs.srv import AddTags, Cancel
from std_srvs.srv import Empty

NOT_IN_TAGS = re.compile(r"[^\w .:/=+@-]")


def state(name, x=0.0, y=0.0):
    found = ModelState(model_name=name)
    found.pose.position.x, found.pose.position.y, found.pose.orientation.w = x, y, 1.0
    return found


class Mover:
    def __init__(self):
        self.looks, self.tags = 0, {}
        self.topic = rospy.Publisher("/gazebo/set_model_state", ModelState, queue_size=1)
        rospy.Subscriber("/gazebo/model_states", ModelStates, self.look, queue_size=1)

    def look(self, states):
        place = states.pose[states.name.index("rover")].position
        call = rospy.ServiceProxy
        self.looks += 1
        if self.looks == 20:
            done = call("/gazebo/set_model_state", SetModelState)(state("rover", -1.0, 0.5))
            there = call("/gazebo/get_model_state", GetModelState)("rover", "").pose.position
            chair = call("/gazebo/set_model_state", SetModelState)(state("chair"))
            is_now = call("/gazebo/get_physics_properties", GetPhysicsProperties)()
            set_it = call("/gazebo/set_physics_properties", SetPhysicsProperties)
            same = set_it(is_now.time_step, is_now.max_update_rate, is_now.gravity, is_now.ode_config)
            slow = set_it(1.0, is_now.max_update_rate, is_now.gravity, is_now.ode_config)
            self.tags.update(set=str(done.success), there="%g %g" % (there.x, there.y), chair=chair.status_message)
            self.tags.update(same=str(same.success), slow=slow.status_message)
        if self.looks == 21:
            self.tags["service"] = "%.3f %.3f" % (place.x, place.y)
            self.topic.publish(state("rover", 0.25, -0.75))
        if self.looks == 22:
            self.tags["topic"] = "%.3f %.3f" % (place.x, place.y)
            call("/gazebo/" + os.environ.get("RESET", "reset_simulation"), Empty)()
        if self.looks == 23:
            self.tags.update(reset="%.3f %.3f" % (place.x, place.y), result="pass")
            call("/robomaker/job/add_tags", AddTags)(
                [Tag(key=key, value=NOT_IN_TAGS.sub("", value)) for key, value in self.tags.items()]
            )
            call("/robomaker/job/cancel", Cancel)()


rospy.init_node("move")
mover = Mover()
rospy.spin()
