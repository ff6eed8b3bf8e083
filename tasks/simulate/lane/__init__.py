"""One lane: its state, what it senses, one control step, its result row. Engines and chunks may import it."""
