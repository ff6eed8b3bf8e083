"""Programs kept from one process to the next, so that only the first traces them. Only tasks.simulate may import it."""
