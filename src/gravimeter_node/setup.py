from setuptools import find_packages, setup

PACKAGE = "gravimeter_node"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    zip_safe=False,
    maintainer="The Isogal developers",
    description="Simulated gravimeter and its reductions with the navigator's estimate.",
    license="Apache-2.0",
    python_requires=">=3.11",
    extras_require={"test": ["pytest"]},
    entry_points={"console_scripts": ["gravimeter_node = gravimeter_node.node:main"]},
)
