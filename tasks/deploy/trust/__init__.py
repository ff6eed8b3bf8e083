"""Who may say what a robot runs: signed metadata and signatures. All of tasks.deploy but fleet may import it.

Five Ed25519 keys, each for one thing. ``root`` says which keys the others are, ``targets`` says which key deploys,
``deployer`` lists bundles and signs desired states, ``snapshot`` and ``timestamp`` say which metadata is the newest.
Private keys lie in a folder of whoever deploys, never in the store (docs/operate/fleet-trust.md).
"""
