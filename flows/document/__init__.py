"""What a document refers to: references, the tested version, names of resources. All of flows may import it."""
