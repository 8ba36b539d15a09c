from isogal.paper.cases import RIVAL, SETTINGS, Plan


def test_only_what_the_paper_does_not_publish_has_a_fifth_of_the_runs(two_maps):
    plan = Plan(10, str(two_maps), 600.0)
    assert len(SETTINGS) == len(set(SETTINGS))
    assert all(plan.case(s).runs == (2 if s == RIVAL else 10) for s in SETTINGS)
