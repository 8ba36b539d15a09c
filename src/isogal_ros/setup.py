from setuptools import find_packages, setup

PACKAGE = "isogal_ros"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(),
    package_data={f"{PACKAGE}.nodes": ["*.xml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    zip_safe=False,
    maintainer="The Isogal developers",
    description=(
        "What the Isogal nodes share: parameters, conversions, diagnostics, recorder, replayer,"
        " launcher."
    ),
    license="Apache-2.0",
    python_requires=">=3.11",
    extras_require={"test": ["pytest"]},
    entry_points={
        "console_scripts": [
            "isogal_recorder = isogal_ros.bags.recorder:main",
            "isogal_mavlink = isogal_ros.mavlink.node:main",
        ],
        "isogal.message_adapters": [
            "gravity = isogal_ros.messages.gravimeter:gravity",
            "disturbance = isogal_ros.messages.gravimeter:disturbance",
            "magnetic = isogal_ros.messages.magnetometer:magnetic",
            "terrain = isogal_ros.messages.altimeter:terrain",
            "gradient = isogal_ros.messages.gradiometer:gradient",
            "ground = isogal_ros.messages.ground:ground",
        ],
    },
)
