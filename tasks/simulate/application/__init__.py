"""An application's bundle as a simulation uses it: contract, code, robot, sensors.

All of tasks.simulate may import it.
"""
