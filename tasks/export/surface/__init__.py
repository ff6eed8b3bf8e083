"""Floors, walls and windows as meshes and pictures. All of tasks.export may import it."""
