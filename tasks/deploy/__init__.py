"""Fleets, roll-out in waves, and the robot agent."""
