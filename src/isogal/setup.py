"""What ament and colcon want beside pyproject.toml, which has all else."""

from setuptools import setup

PACKAGE = "isogal"

setup(
    license="Apache-2.0",
    python_requires=">=3.11",
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
)
