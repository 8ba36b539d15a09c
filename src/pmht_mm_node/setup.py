from setuptools import find_packages, setup

PACKAGE = "pmht_mm_node"

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
    description="Gravity map matching: batches of reduced readings to position fixes.",
    license="Apache-2.0",
    python_requires=">=3.11",
    extras_require={"test": ["pytest"]},
    entry_points={"console_scripts": ["pmht_mm_node = pmht_mm_node.node:main"]},
)
