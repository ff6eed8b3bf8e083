// A Timer in simulated time drives by the last scan.
#include <algorithm>

#include <geometry_msgs/Twist.h>
#include <ros/ros.h>
#include <sensor_msgs/LaserScan.h>

int main(int count, char** arguments) {
  ros::init(count, arguments, "wheel");
  ros::NodeHandle node;
  double nearest = 9.0;
  ros::Publisher commands = node.advertise<geometry_msgs::Twist>("/cmd_vel", 1);
  ros::Subscriber scans = node.subscribe<sensor_msgs::LaserScan>(
      "/scan", 1, [&](const sensor_msgs::LaserScan::ConstPtr& scan) {
        nearest = *std::min_element(scan->ranges.begin(), scan->ranges.end());
      });
  ros::Timer timer = node.createTimer(ros::Duration(0.1), [&](const ros::TimerEvent&) {
    geometry_msgs::Twist command;
    command.linear.x = std::min(0.3, nearest / 3.0);
    command.angular.z = nearest < 0.5 ? 0.8 : 0.1;
    commands.publish(command);
  });
  ros::spin();
  return 0;
}
