from setuptools import setup

setup(
    name="roamer2",
    version="1.0.0",
    packages=["roamer2"],
    data_files=[("share/roamer2", ["package.xml"]), ("share/roamer2/launch", ["launch/roam.launch.py"])],
    entry_points={"console_scripts": ["roam = roamer2.roam:main", "watch = roamer2.watch:main"]},
)
