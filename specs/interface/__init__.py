"""RoboMaker's interface as data: its operations, and the shapes of their requests and answers. Anyone may import it."""
