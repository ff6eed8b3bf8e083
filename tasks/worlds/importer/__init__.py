"""Worlds of one's own: Gazebo worlds, scenes of MuJoCo and meshes as upright solids. Jobs and above may import it."""
