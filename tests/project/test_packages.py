"""The packages under src/ as pip, colcon and rosdep see them."""

import xml.etree.ElementTree as ET
from configparser import ConfigParser
from importlib.metadata import distribution
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
    required,
    required_by_file,
)
from isogal.cli.errors import EXTRAS


@pytest.mark.parametrize("package", PACKAGES, ids=NAMES)
def test_package_xml_and_setup_agree(package: Path) -> None:
    root = ET.parse(package / "package.xml").getroot()
    manifest = {element.tag: element.text for element in root}
    metadata = distribution(package.name).metadata
    assert root.get("format") == "3"
    for key, known in (("name", "Name"), ("version", "Version"), ("description", "Summary")):
        assert manifest[key] == metadata[known], key
    assert manifest["name"] == package.name
    assert manifest["license"] == metadata["License"] == "Apache-2.0"
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
    library = distribution("isogal")
    core = required(library.requires)
    extras = {
        extra: required(library.requires, extra)
        for extra in library.metadata.get_all("Provides-Extra")
    }
    declared = core.union(*extras.values())
    needed = {
        DISTRIBUTIONS.get(name, name).lower()
        for name in imports(LIBRARY) - ROS - {"isogal_ros", "setuptools"}
    }
    assert needed <= declared
    assert core <= required_by_file("requirements.in")
    # what a plain installation does without is named when it is missed
    named = {DISTRIBUTIONS.get(name, name): extra for name, extra in EXTRAS.items()}
    assert all(name in extras[extra] for name, extra in named.items())
    assert needed - core <= named.keys()


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
    requires = distribution(package.name).requires
    assert required(requires, "test") - required(requires) == {"pytest"}


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
    # what docker/ installs with pip, because apt has none or too old a one
    pip_only = {
        name.replace("-support", "").replace("-", "_")
        for name in required_by_file("docker/requirements.in")
    }
    undeclared = {
        name
        for name in imports(package) - pip_only - OPTIONAL
        if (
            name not in declared if name in ROS or name in NAMES else APT.get(name) not in declared
        )
    }
    # The commands that drive the graph import isogal_ros only when they are called; without it
    # they say so.
    assert undeclared <= ({"isogal_ros"} if package.name == "isogal" else set())


@pytest.mark.parametrize("package", PACKAGES, ids=NAMES)
def test_entry_points_can_be_imported(package: Path) -> None:
    for entry in distribution(package.name).entry_points:
        found = entry.load()
        assert entry.group != "console_scripts" or callable(found), entry


def test_colcon_workspace_holds_the_sources() -> None:
    link = ROOT / "ros2_ws" / "src"
    assert link.is_symlink()
    assert str(link.readlink()) == "../src"
