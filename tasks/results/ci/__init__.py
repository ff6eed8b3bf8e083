"""What CI shows of a run: its whole report, JUnit, Markdown, annotations. Flows may import it."""
