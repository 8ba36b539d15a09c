"""Which of several publishers is used."""

from isogal_ros.nodes.sources import NAMELESS, Sources

A, B, C = b"a", b"b", b"c"


def test_the_first_is_used_until_it_has_left() -> None:
    there = {A: "/one", B: "/two"}
    sources = Sources(lambda: dict(there))
    assert sources.refuse(A, False) is None
    assert sources.refuse(B, False) == "of a second publisher, /two: /one is used"
    assert sources.several == "published by /two, too: /one is used"
    del there[A]
    assert sources.refuse(B, False) is None
    assert sources.several is None
    there[A] = "/one"
    assert sources.refuse(A, False) == "of a second publisher, /one: /two is used"


def test_the_only_one_is_used_whatever_is_said_of_the_others() -> None:
    """What is known of who is there may be late."""
    sources = Sources(lambda: {A: "/one", B: "/two"})
    assert sources.refuse(A, False) is None
    assert sources.refuse(B, True) is None
    assert sources.refuse(A, False) == "of a second publisher, /one: /two is used"


def test_a_successor_does_not_wait() -> None:
    there = {A: "/one"}
    sources = Sources(lambda: dict(there))
    assert sources.refuse(A, True) is None
    there[B] = "/one"
    assert sources.refuse(B, False) is None
    assert sources.several is None  # most likely
    there[C] = "/one"
    assert sources.refuse(C, False) is None
    assert sources.refuse(C, False) is None


def test_one_beside_which_the_first_is_heard_is_no_successor() -> None:
    there = {A: "/one"}
    sources = Sources(lambda: dict(there))
    assert sources.refuse(A, True) is None
    there[B] = "/one"
    assert sources.refuse(B, False) is None
    assert sources.refuse(A, False) is None
    assert sources.refuse(B, False) == "of a second publisher, another /one: /one is used"
    assert sources.several == "published by another /one, too: /one is used"
    del there[A]
    assert sources.refuse(B, False) is None


def test_one_whose_name_is_not_known_yet_may_be_the_successor() -> None:
    there = {A: "/one"}
    sources = Sources(lambda: dict(there))
    assert sources.refuse(A, True) is None
    there[B] = NAMELESS
    assert sources.refuse(B, False) is None
    there[B] = "/two"
    assert sources.refuse(A, False) is None
    assert sources.refuse(B, False) == "of a second publisher, /two: /one is used"


def test_where_nobody_says_who_is_there_all_are_used() -> None:
    sources = Sources(dict)
    assert [sources.refuse(gid, False) for gid in (A, B, A, C)] == [None] * 4
    assert sources.several is None
