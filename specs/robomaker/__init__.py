"""RoboMaker's requests and answers, field by field. Anyone may import it."""
