"""How colcon installs the package."""

from glob import glob

from setuptools import setup

NAME = "palpate_ros"

setup(
    name=NAME,
    version="0.3.0",
    description="Runs palpate live as a node of ROS 2",
    license="Apache-2.0",
    maintainer="The Palpate authors",
    maintainer_email="palpate@example.org",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", glob("launch/*")),
        (f"share/{NAME}/config", glob("config/*")),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    entry_points={"console_scripts": [f"live = {NAME}.live:main"]},
)
