from pathlib import Path

from isogal.paper.cases import AIDING, SETTINGS, TABLES, UNAIDED, Plan


def test_only_what_the_paper_does_not_publish_has_a_fifth_of_the_runs(two_maps: Path) -> None:
    plan = Plan(10, str(two_maps), 600.0)
    published = {*TABLES, *AIDING, *UNAIDED}
    assert len(SETTINGS) == len(set(SETTINGS)) > len(published)
    assert {plan.case(s).runs for s in SETTINGS if s in published} == {10}
    assert {plan.case(s).runs for s in SETTINGS if s not in published} == {2}
