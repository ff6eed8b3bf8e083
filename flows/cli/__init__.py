"""The shell, `simyard`: a module for each family of commands, imported when one is called. Nobody imports it."""
