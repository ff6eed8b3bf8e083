"""Rooms are furnished: groups, intervals, placement, assembly. Generation may import it."""
