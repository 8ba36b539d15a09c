"""Reads what the packages under src/ declare: setup.py, package.xml, imports."""

import ast
import re
import sys
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

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


def pip_only() -> set[str]:
    """Import names of what docker/ installs with pip because apt has none or too old a one."""
    lines = (ROOT / "docker" / "requirements.in").read_text(encoding="utf-8").splitlines()
    names = {
        re.split(r"[\[<>=; ]", line, maxsplit=1)[0] for line in lines if line and line[0].isalpha()
    }
    return {{"mcap-ros2-support": "mcap_ros2"}.get(name, name) for name in names}


def setup_arguments(package: Path) -> dict[str, Any]:
    """Return the literal arguments of the setup() call, and those that are the variable
    PACKAGE; where there is a pyproject.toml, what it says in their form."""
    tree = ast.parse((package / "setup.py").read_text(encoding="utf-8"))
    call = next(
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "setup"
    )
    arguments = _pyproject_arguments(package)
    for keyword in call.keywords:
        if isinstance(keyword.value, ast.Name) and keyword.value.id == "PACKAGE":
            arguments[str(keyword.arg)] = package.name
            continue
        try:
            arguments[str(keyword.arg)] = ast.literal_eval(keyword.value)
        except ValueError:
            continue  # find_packages() and data files are not literals
    return arguments


def _pyproject_arguments(package: Path) -> dict[str, Any]:
    path = package / "pyproject.toml"
    if not path.is_file():
        return {}
    project = project_table(package)
    groups = {"console_scripts": project["scripts"], **project["entry-points"]}
    found = re.search(
        r'^__version__ = "(.+)"$',
        (package / package.name / "__init__.py").read_text(encoding="utf-8"),
        re.MULTILINE,
    )
    assert found is not None
    return {
        "name": project["name"],
        "description": project["description"],
        "version": found[1],
        "entry_points": {
            group: [f"{name} = {target}" for name, target in entries.items()]
            for group, entries in groups.items()
        },
    }


def project_table(package: Path) -> dict[str, Any]:
    """Return what a package's pyproject.toml says of it."""
    text = (package / "pyproject.toml").read_text(encoding="utf-8")
    table: dict[str, Any] = tomllib.loads(text)["project"]
    return table


def requirement_names(lines: Iterable[str]) -> set[str]:
    """Return the names of required distributions, in lower case."""
    return {
        re.split(r"[\[<>=!~; ]", line, maxsplit=1)[0].lower()
        for line in lines
        if line[:1].isalpha()
    }


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
        package.name: {
            script.partition("=")[0].strip()
            for script in (
                setup_arguments(package).get("entry_points", {}).get("console_scripts", [])
            )
        }
        for package in PACKAGES
    }
