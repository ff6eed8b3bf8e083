"""Fleets, roll-outs in waves, and the robot agent. Flows may import it."""
