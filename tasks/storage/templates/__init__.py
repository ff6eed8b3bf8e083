"""World templates: their bodies by digest, and the records of those that somebody named. Flows may import it."""
