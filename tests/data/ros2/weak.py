"""A node that publishes commands best effort, as sensors do."""

from player import SENSOR_DATA, Node, Twist

node = Node()
node.publisher("/cmd_vel", Twist, SENSOR_DATA)
node.spin()
