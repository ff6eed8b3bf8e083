"""Networks in ONNX as controllers: their file and declaration, read and run. The table of kinds imports it."""
