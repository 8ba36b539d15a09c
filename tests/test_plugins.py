"""Objects by name from entry points: their order, and one clear line for whatever is wrong."""

import sys

import pytest

from helpers import installed
from isogal import plugins
from isogal.errors import InputError
from isogal.matching.registry import load_matcher
from isogal.scenario import Matcher


@pytest.fixture
def install(tmp_path):
    """Install a package with entry points in the group of matchers for one test."""
    with installed.known(tmp_path):
        yield lambda package, module="", **objects: installed.install(
            tmp_path, package, module, matchers=objects
        )


def test_isogals_own_come_first_and_others_follow_in_alphabetical_order(install):
    own = plugins.names(plugins.MATCHERS)
    assert own == tuple(sorted(own))
    install("zebra", aardvark="zebra:x")
    install("ant", mole="ant:x", badger="ant:x")
    assert plugins.names(plugins.MATCHERS) == (*own, "aardvark", "badger", "mole")


def test_an_object_of_another_package_is_loaded(install):
    install("ant", "class Mole:\n    answer = 42\n", mole="ant:Mole", answer="ant:Mole.answer")
    assert plugins.load(plugins.MATCHERS, "mole").answer == 42
    assert plugins.load(plugins.MATCHERS, "answer") == 42


def test_a_matcher_that_is_none_is_refused(install):
    module = """
class Mole:
    name = 'mole'
    @classmethod
    def from_settings(cls, settings):
        return cls()
"""
    install("bee", module, mole="bee:Mole", word="bee:Mole.name")
    for name, lacks in (("mole", "context"), ("word", "from_settings, name, context")):
        with pytest.raises(InputError, match=f"'{name}': its package gives no .* lacks {lacks}, "):
            load_matcher(Matcher(name=name))


def test_a_name_of_two_packages_is_refused_and_both_are_named(install):
    install("ant", pmht="ant:x")
    with pytest.raises(InputError, match=r"matcher 'pmht': both isogal and ant provide it"):
        plugins.names(plugins.MATCHERS)


@pytest.mark.parametrize(
    ("module", "why"),
    [
        ("import nothing_of_this_name", "ModuleNotFoundError: No module named 'nothing_of_th"),
        ("y = 1", "AttributeError: module 'ant' has no attribute 'x'"),
        ("x = 1 / 0", "ZeroDivisionError: division by zero"),
    ],
)
def test_a_package_that_cannot_be_imported_is_named(install, module, why):
    install("ant", module, mole="ant:x")
    sys.modules.pop("ant", None)
    with pytest.raises(InputError) as caught:
        plugins.load(plugins.MATCHERS, "mole")
    assert str(caught.value).startswith(
        f"matcher 'mole' of the package ant cannot be imported: {why}"
    )


@pytest.mark.parametrize(
    "group",
    [
        plugins.MATCHERS,
        plugins.MAP_FORMATS,
        plugins.FIELDS,
        pytest.param(plugins.MESSAGE_ADAPTERS, marks=pytest.mark.ros),
    ],
)
def test_everything_that_isogal_registers_can_be_loaded(group):
    assert plugins.names(group)
    for name in plugins.names(group):
        plugins.load(group, name)
