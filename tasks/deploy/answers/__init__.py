"""Deployments, fleets and robots in RoboMaker's words and as rows. Flows may import it."""
