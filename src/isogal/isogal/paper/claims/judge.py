"""All claims, decided in the paper's order."""

from isogal.paper.claims import discussion, errors, method, navigator
from isogal.paper.claims.verdicts import HOLDS, Claim, Rule
from isogal.paper.results import Results

RULES: tuple[Rule, ...] = (
    *method.RULES,
    *navigator.RULES,
    *errors.RULES,
    *discussion.RULES,
)


def judge(results: Results) -> tuple[Claim, ...]:
    """Decide all claims."""
    claims = []
    for rule in RULES:
        measured, verdict = rule.decide(results)
        why = rule.why(results) if rule.why is not None and verdict != HOLDS else ""
        claims.append(Claim(rule.key, rule.source, rule.text, measured, verdict, why))
    return tuple(claims)
