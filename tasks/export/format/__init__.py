"""A module for each export format, each a pure function of a world. Export jobs and pictures may import it."""
