// A Timer in simulated time drives by the last scan; with ~periods_ms, the last of several threads that poll does, each
// for what the one before it found; with ~race, one of two threads that wait for the same tick, by what the other counts.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <thread>
#include <vector>

#include <geometry_msgs/Twist.h>
#include <ros/ros.h>
#include <sensor_msgs/LaserScan.h>

int main(int count, char** arguments) {
  ros::init(count, arguments, "wheel");
  ros::NodeHandle node;
  std::atomic<double> nearest{9.0};
  ros::Publisher commands = node.advertise<geometry_msgs::Twist>("/cmd_vel", 1);
  auto drive = [&] {
    geometry_msgs::Twist command;
    command.linear.x = std::min(0.3, nearest / 3.0);
    command.angular.z = nearest < 0.5 ? 0.8 : 0.1;
    commands.publish(command);
  };
  std::vector<double> periods_ms;
  ros::param::get("~periods_ms", periods_ms);
  std::vector<std::atomic<int>> found(periods_ms.size() + 1);
  const bool race = ros::param::param("~race", false);
  std::atomic<int> count_ticks{0};
  std::vector<std::thread> threads;
  auto race_to_tick = [&](bool drives) {
    int driven = 0;
    for (ros::Rate rate(20.0); rate.sleep(), ros::ok();) {
      if (!drives) {
        ++count_ticks;
      } else {
        geometry_msgs::Twist command;
        command.linear.x = 0.1;
        command.angular.z = 0.1 * (count_ticks - ++driven);
        commands.publish(command);
      }
    }
  };
  ros::Subscriber scans = node.subscribe<sensor_msgs::LaserScan>(
      "/scan", 1, [&](const sensor_msgs::LaserScan::ConstPtr& scan) {
        nearest = *std::min_element(scan->ranges.begin(), scan->ranges.end());
        ++found[0];
        if (race && threads.empty()) {
          for (bool drives : {false, true}) threads.emplace_back(race_to_tick, drives);
        }
      });
  auto poll = [&](size_t number) {
    const std::chrono::duration<double, std::milli> period(periods_ms[number]);
    std::mutex mutex;
    std::condition_variable nobody_notifies;
    while (ros::ok()) {
      if (number % 2) {
        std::this_thread::sleep_for(period);
      } else {
        std::unique_lock<std::mutex> lock(mutex);
        nobody_notifies.wait_for(lock, period);
      }
      const int seen = found[number];
      if (found[number + 1] == seen) continue;
      if (number + 1 == periods_ms.size()) drive();
      found[number + 1] = seen;
    }
  };
  for (size_t number = 0; number < periods_ms.size(); ++number) threads.emplace_back(poll, number);
  ros::Timer timer;
  if (periods_ms.empty() && !race) timer = node.createTimer(ros::Duration(0.1), [&](const ros::TimerEvent&) { drive(); });
  ros::spin();
  for (std::thread& thread : threads) thread.join();
  return 0;
}
