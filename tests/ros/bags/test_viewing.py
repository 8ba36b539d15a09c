"""What was said of aids, as times over which each was used."""

from isogal.evaluation.view.record import AidUse
from isogal_ros.bags.record import Said
from isogal_ros.bags.viewing import uses_of

SECOND = 1_000_000_000


def test_a_use_goes_on_until_something_else_is_said() -> None:
    said = [
        Said(time * SECOND, level, name, text)
        for time, level, name, text in (
            (0, "OK", "gnss/fix", "used"),
            (0, "WARN", "velocity/data_raw", "never: nothing has come yet"),
            (1, "OK", "gnss/fix", "used"),
            (5, "WARN", "gnss/fix", "not since 2 s: the receiver has no fix"),
            (5, "OK", "velocity/data_raw", "used"),
            (6, "WARN", "gnss/fix", "not since 3 s: the receiver has no fix"),
            (9, "OK", "gnss/fix", "used"),
            (12, "OK", "gnss/fix", "used"),
        )
    ]
    assert uses_of(said) == [
        AidUse("gnss/fix", 0.0, 5.0, True, "used"),
        AidUse("velocity/data_raw", 0.0, 5.0, False, "never: nothing has come yet"),
        AidUse("gnss/fix", 5.0, 9.0, False, "not since 2 s: the receiver has no fix"),
        AidUse("velocity/data_raw", 5.0, 5.0, True, "used"),
        AidUse("gnss/fix", 9.0, 12.0, True, "used"),
    ]
