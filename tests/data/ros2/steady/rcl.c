/* What rclcpp calls of rcl, as far as it tells times: it believes whatever it is told. */
int rcl_enable_ros_time_override(void *clock) { return !clock; }
int rcl_set_ros_time_override(void *clock, long ns) { return !clock || ns < 0; }
const char *rcl_publisher_get_topic_name(const void *publisher) { return publisher; }
int rcl_publish(const void *publisher, const void *message, void *allocation) { return !publisher + !message + !!allocation; }
