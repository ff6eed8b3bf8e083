"""Nodes in Python and C++, and RoboMaker's messages, for tests with a real ROS."""

# Publishes its cached parameter on each scan, and at once; calls a service; hears a latched topic.
CPP = r"""
#include <ros/ros.h>
#include <roscpp/Empty.h>
#include <geometry_msgs/Twist.h>
#include <sensor_msgs/LaserScan.h>
int main(int argc, char** argv) {
  ros::init(argc, argv, "cpp");
  ros::NodeHandle node, own("~");
  ros::Publisher out = node.advertise<geometry_msgs::Twist>("cmd_vel", 10);
  geometry_msgs::Twist first;
  first.linear.x = -1.0;
  out.publish(first);
  double limit = 0.0;
  ros::Subscriber plan = node.subscribe<geometry_msgs::Twist>(
      "plan", 1, [&](const geometry_msgs::Twist::ConstPtr& each) { limit = each->linear.y; });
  ros::Subscriber scan = node.subscribe<sensor_msgs::LaserScan>(
      "scan", 1, [&](const sensor_msgs::LaserScan::ConstPtr&) {
        geometry_msgs::Twist command;
        own.getParamCached("gain", command.linear.x);
        command.linear.y = limit;
        out.publish(command);
      });
  ros::ServiceClient reset = node.serviceClient<roscpp::Empty>("reset");
  if (own.param("calls", false) && reset.waitForExistence(ros::Duration(20))) {
    roscpp::Empty request;
    ROS_INFO("reset: %d", reset.call(request));
  }
  ros::spin();
}
"""

# The same in Python; it provides the service and the latched topic.
PYTHON = r"""
import rospy
from geometry_msgs.msg import Twist
from roscpp.srv import Empty, EmptyResponse
from sensor_msgs.msg import LaserScan

rospy.init_node("python")
out = rospy.Publisher("cmd_vel", Twist, queue_size=10)
first = Twist()
first.linear.x = -2.0
out.publish(first)
plan = rospy.Publisher("plan", Twist, queue_size=1, latch=True)
limit = Twist()
limit.linear.y = 0.25
plan.publish(limit)

def reset(request):
    rospy.set_param("/resets", rospy.get_param("/resets", 0) + 1)
    return EmptyResponse()

def scan(message):
    command = Twist()
    command.linear.x = rospy.get_param_cached("~gain", 0.0)
    out.publish(command)

rospy.Service("reset", Empty, reset)
rospy.Subscriber("scan", LaserScan, scan)
rospy.spin()
"""

ACTION_SERVER = r"""
import actionlib
import rospy
from actionlib.msg import TwoIntsAction, TwoIntsResult

rospy.init_node("adder")

def add(goal):
    rospy.sleep(0.2)
    server.set_succeeded(TwoIntsResult(goal.a + goal.b))

server = actionlib.SimpleActionServer("add", TwoIntsAction, add, auto_start=False)
server.start()
rospy.spin()
"""

ACTION_CLIENT = r"""
import actionlib
import rospy
from actionlib.msg import TwoIntsAction, TwoIntsGoal

rospy.init_node("asker")
client = actionlib.SimpleActionClient("add", TwoIntsAction)
client.wait_for_server()
client.send_goal_and_wait(TwoIntsGoal(20, 22))
rospy.set_param("/sum", client.get_result().sum)
"""

# Fields of RoboMaker's package robomaker_simulation_msgs.
TAG = "string key\nstring value\n"
ADD_TAGS = "Tag[] tags\n---\nbool success\nstring message\n"
CANCEL = "---\nbool success\nstring message\n"
