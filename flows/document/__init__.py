"""What a document refers to: its references, and the batch that it tests. All of flows may import it."""
