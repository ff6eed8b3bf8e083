"""What the functions of `simyard` return: frozen objects that a notebook shows. Only `simyard` imports it."""
