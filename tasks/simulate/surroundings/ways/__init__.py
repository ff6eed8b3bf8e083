"""The ways of a disc on a world's floor: where it has room, straight ways, shortest ways. Lanes may import it."""
