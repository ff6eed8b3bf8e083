"""A document's nights: found in the store, made into a trend, its page and its alarms. Stages may import it."""
