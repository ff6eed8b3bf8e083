"""A WorldForge template becomes certified apartments."""
