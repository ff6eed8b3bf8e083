"""An application's bundle in a simulation: contract, code, robot, sensors. All of tasks.simulate may import it."""
