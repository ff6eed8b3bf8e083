"""The commands that take a document: `run`, `plan`, `validate`. Only the shell imports it."""
