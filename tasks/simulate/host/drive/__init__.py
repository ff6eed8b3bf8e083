"""What a Twist does to a robot, read from its robot.xml: for robots that take Twists. Host alone imports it."""
