"""The commands of `simyard fleet`. Only the shell imports it."""
