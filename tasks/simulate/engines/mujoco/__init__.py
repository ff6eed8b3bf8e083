"""The mujoco engine: C MuJoCo on the host. Only tasks.simulate.engines may import it."""
