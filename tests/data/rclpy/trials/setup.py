from setuptools import setup

setup(
    name="trials",
    packages=["trials"],
    entry_points={
        "console_scripts": [
            "threads = trials.nodes:threads",
            "faulty = trials.nodes:faulty",
            "stamped = trials.nodes:stamped",
            "seer = trials.nodes:seer",
            "counter = trials.nodes:counter",
            "asker = trials.nodes:asker",
            "walltimer = trials.nodes:walltimer",
            "turns = trials.nodes:turns",
            "looker = trials.nodes:looker",
            "part = trials.nodes:part",
        ]
    },
)
