"""HTTP in RoboMaker's form: requests, answers, signatures, keys, pages of a browser. Only flows import it."""
