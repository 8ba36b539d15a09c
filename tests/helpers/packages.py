"""Reads what the packages under src/ declare, as installed and in package.xml, and import."""

import ast
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from functools import cache
from importlib.metadata import distribution
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = sorted(path.parent for path in (ROOT / "src").glob("*/package.xml"))
NAMES = [package.name for package in PACKAGES]

# Import name -> rosdep key. Each key exists in rosdistro's rosdep/python.yaml with an apt package
# on Ubuntu 24.04.
APT = {
    "numpy": "python3-numpy",
    "scipy": "python3-scipy",
    "matplotlib": "python3-matplotlib",
    "netCDF4": "python3-netcdf4",
    "PIL": "python3-pil",
    "pyproj": "python3-pyproj",
    "yaml": "python3-yaml",
    "typing_extensions": "python3-typing-extensions",
    "psutil": "python3-psutil",
    "pytest": "python3-pytest",
    "setuptools": "python3-setuptools",
}
ROS = {
    *("rclpy", "ament_index_python", "launch", "launch_ros", "rosidl_runtime_py"),
    *("builtin_interfaces", "diagnostic_msgs", "geometry_msgs", "nav_msgs", "rcl_interfaces"),
    *("rosgraph_msgs", "sensor_msgs", "std_msgs", "std_srvs", "lifecycle_msgs", "tf2_msgs"),
}


def required(lines: Iterable[str], extra: str = "") -> set[str]:
    """Names of the distributions in lines as pip reads them, in lower case; those of one extra
    besides those of none."""
    found = (Requirement(line.partition(" #")[0]) for line in lines if line[:1].isalpha())
    return {
        one.name.lower()
        for one in found
        if one.marker is None or one.marker.evaluate({"extra": extra})
    }


def required_by_file(name: str) -> set[str]:
    """The same of a file of requirements, relative to the repository."""
    return required((ROOT / name).read_text(encoding="utf-8").splitlines())


def dependencies(package: Path) -> set[str]:
    root = ET.parse(package / "package.xml").getroot()
    return {str(element.text) for element in root if element.tag.endswith("depend")}


@cache
def imports(package: Path) -> set[str]:
    found = set()
    for source in package.rglob("*.py"):
        parts = source.relative_to(package).parts
        if source.name == "setup.py" or {"build", "test"} & {*parts}:
            continue
        for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module.split(".")[0])
    return found - set(sys.stdlib_module_names) - {package.name}


def executables() -> dict[str, set[str]]:
    """Package -> names of its console scripts."""
    return {
        name: distribution(name).entry_points.select(group="console_scripts").names
        for name in NAMES
    }
