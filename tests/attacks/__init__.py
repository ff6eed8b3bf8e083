"""Attacks by somebody who can write to the store and has no key: each succeeded on commit d54b1a2, and fails now."""
