"""The process that applications run in, from outside: started, confined, asked. Batch, audit, replay may import it."""
