"""The packages under src/ as pip, colcon and rosdep see them."""

import xml.etree.ElementTree as ET
from configparser import ConfigParser
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

import isogal
from helpers.packages import (
    APT,
    NAMES,
    PACKAGES,
    ROOT,
    ROS,
    dependencies,
    imports,
    pip_only,
    project_table,
    requirement_names,
    setup_arguments,
)
from isogal.cli.errors import EXTRAS


@pytest.mark.parametrize("package", PACKAGES, ids=NAMES)
def test_package_xml_and_setup_agree(package: Path) -> None:
    root = ET.parse(package / "package.xml").getroot()
    manifest = {element.tag: element.text for element in root}
    setup = setup_arguments(package)
    assert root.get("format") == "3"
    for key in ("name", "version", "description", "license"):
        assert manifest[key] == setup[key], key
    assert manifest["name"] == package.name
    assert manifest["license"] == "Apache-2.0"
    assert manifest["version"] == isogal.__version__
    assert root.findtext("export/build_type") == "ament_python"


LIBRARY = ROOT / "src" / "isogal"
# Import name -> name of the distribution, where they differ.
DISTRIBUTIONS = {
    "yaml": "pyyaml",
    "PIL": "pillow",
    "distributed": "dask",
    "mcap_ros2": "mcap-ros2-support",
}


def test_pip_installs_what_the_library_imports() -> None:
    project = project_table(LIBRARY)
    extras = project["optional-dependencies"]
    declared = requirement_names(
        [*project["dependencies"], *(line for lines in extras.values() for line in lines)]
    )
    needed = {
        DISTRIBUTIONS.get(name, name).lower()
        for name in imports(LIBRARY) - ROS - {"isogal_ros", "setuptools"}
    }
    assert needed <= declared
    wanted = (ROOT / "requirements.in").read_text(encoding="utf-8").splitlines()
    core = requirement_names(project["dependencies"])
    assert core <= requirement_names(wanted)
    # what a plain installation does without is named when it is missed
    assert {DISTRIBUTIONS.get(name, name) for name in EXTRAS} <= declared
    for name, extra in EXTRAS.items():
        assert DISTRIBUTIONS.get(name, name) in requirement_names(extras[extra])
    assert needed - core <= {DISTRIBUTIONS.get(name, name) for name in EXTRAS}


@pytest.mark.parametrize("package", PACKAGES, ids=NAMES)
def test_ament_finds_the_package_and_colcon_its_tests(package: Path) -> None:
    """By the extra `test`; it runs pytest in the package's folder, whose configuration is not to
    be that of the repository."""
    assert (package / "resource" / package.name).is_file()
    config = ConfigParser()
    config.read(package / "setup.cfg")
    assert config["install"]["install_scripts"] == f"$base/lib/{package.name}"
    assert config["develop"]["script_dir"] == f"$base/lib/{package.name}"
    assert config["tool:pytest"]["testpaths"] == "test"
    assert list((package / "test").glob("test_*.py"))
    pyproject = package / "pyproject.toml"
    extras = setup_arguments(package).get("extras_require") or (
        project_table(package)["optional-dependencies"] if pyproject.exists() else {}
    )
    assert extras["test"] == ["pytest"]


@pytest.mark.parametrize("package", PACKAGES, ids=NAMES)
def test_every_module_is_in_a_package(package: Path) -> None:
    # Without __init__.py a folder is found in an editable install, and missing from a colcon
    # build.
    folders = {module.parent for module in (package / package.name).rglob("*.py")}
    assert [
        str(folder.relative_to(package))
        for folder in folders
        if not (folder / "__init__.py").is_file()
    ] == []


@pytest.mark.parametrize("package", PACKAGES, ids=NAMES)
def test_every_dependency_can_be_resolved(package: Path) -> None:
    assert dependencies(package) <= set(APT.values()) | ROS | set(NAMES)


OPTIONAL = {"pymavlink", "pyshtools"}
"""What is said to be lacking, where it is: ROS has no package of it."""


@pytest.mark.parametrize("package", PACKAGES, ids=NAMES)
def test_every_import_is_declared(package: Path) -> None:
    declared = dependencies(package)
    undeclared = {
        name
        for name in imports(package) - pip_only() - OPTIONAL
        if (
            name not in declared if name in ROS or name in NAMES else APT.get(name) not in declared
        )
    }
    # The commands that drive the graph import isogal_ros only when they are called; without it
    # they say so.
    assert undeclared <= ({"isogal_ros"} if package.name == "isogal" else set())


@pytest.mark.parametrize("package", PACKAGES, ids=NAMES)
def test_entry_points_can_be_imported(package: Path) -> None:
    for group, lines in setup_arguments(package).get("entry_points", {}).items():
        for line in lines:
            name, _, target = (part.strip() for part in line.partition("="))
            found = EntryPoint(name, target, group).load()
            assert group != "console_scripts" or callable(found), line


def test_colcon_workspace_holds_the_sources() -> None:
    link = ROOT / "ros2_ws" / "src"
    assert link.is_symlink()
    assert str(link.readlink()) == "../src"
