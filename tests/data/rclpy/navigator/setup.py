from setuptools import setup

setup(
    name="navigator",
    packages=["navigator"],
    entry_points={"console_scripts": ["navigator = navigator.navigator:main"]},
)
