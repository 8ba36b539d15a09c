from setuptools import find_packages, setup

PACKAGE = "isogal"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(),
    package_data={
        PACKAGE: ["py.typed", "scenario/imu_grades.yaml", "evaluation/view/view.*"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    zip_safe=False,
    maintainer="The Isogal developers",
    description=(
        "Gravity map matching that stops an inertial navigator from drifting: the algorithms,"
        " without ROS."
    ),
    license="Apache-2.0",
    python_requires=">=3.11",
    entry_points={
        "console_scripts": ["isogal = isogal.cli.main:main"],
        "isogal.matchers": [
            "pmht = isogal.matching.pmht.matcher:Pmht",
            "pmht-paper = isogal.matching.paper.matcher:PmhtPaper",
            "tercom = isogal.matching.baselines.tercom:Tercom",
            "iccp = isogal.matching.baselines.iccp:Iccp",
            "sitan = isogal.matching.baselines.sitan:Sitan",
            "particle = isogal.matching.baselines.particle:Particle",
            "point-mass = isogal.matching.baselines.point_mass:PointMass",
            "viterbi = isogal.matching.baselines.viterbi:Viterbi",
        ],
        "isogal.map_formats": [
            "netcdf = isogal.maps.formats.netcdf:FORMAT",
            "ggmplus = isogal.maps.ggmplus.reading:FORMAT",
            "geotiff = isogal.maps.formats.geotiff:FORMAT",
            "gdf = isogal.maps.formats.gdf:FORMAT",
            "xyz = isogal.maps.formats.xyz:FORMAT",
        ],
        "isogal.fields": [
            "gravity = isogal.fields.gravity:GRAVITY",
            "disturbance = isogal.fields.gravity:DISTURBANCE",
            "magnetic = isogal.fields.magnetic:MAGNETIC",
            "terrain = isogal.fields.terrain:TERRAIN",
            "gradient = isogal.fields.gradient:GRADIENT",
        ],
    },
)
