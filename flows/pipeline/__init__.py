"""What a document asks for, and a run of it as plain functions, without Prefect. The shell may import it."""
