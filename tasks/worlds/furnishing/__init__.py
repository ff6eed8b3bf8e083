"""Rooms are furnished: programme, groups, spots, placement. Generation may import it."""
