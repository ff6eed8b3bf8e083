"""Bundles of robot and simulation applications, and their numbered versions. Flows may import it."""
