from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "isogal_bringup"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/launch", sorted(map(str, Path("launch").glob("*.py")))),
        (f"share/{PACKAGE}/params", sorted(map(str, Path("params").glob("*.yaml")))),
        (f"share/{PACKAGE}/viewer", sorted(map(str, Path("viewer").glob("*.*")))),
    ],
    zip_safe=False,
    maintainer="The Isogal developers",
    description="Launch file, parameters and viewer layouts of the Isogal graph.",
    license="Apache-2.0",
    python_requires=">=3.11",
    extras_require={"test": ["pytest"]},
)
