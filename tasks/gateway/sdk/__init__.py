"""The description of RoboMaker's API that SDKs read, made from specs. Only flows import it."""
