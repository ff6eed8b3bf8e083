"""JAX's settings, made before any test module here imports it."""

from tasks.simulate.devices import prepare_devices

prepare_devices()
