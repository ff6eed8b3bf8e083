"""The mujoco engine: C MuJoCo on the host. Only tasks.simulate.engine may import it."""
