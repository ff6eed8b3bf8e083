"""Boxes, overlaps, clearance: geometry of the floor. All of tasks.worlds may import it."""
