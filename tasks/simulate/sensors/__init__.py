"""The sensors, one module each, and the table of them. Lanes, engines and replays may import it."""
