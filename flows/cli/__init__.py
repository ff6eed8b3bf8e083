"""The shell, `simyard`: thin commands that import what they need when they run. Nobody imports it."""
