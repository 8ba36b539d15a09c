"""``isogal paper``: the paper's tables and figures, simulated anew and set beside its values."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from isogal.cli.montecarlo import ending_well
from isogal.cli.option_groups import with_groups
from isogal.cli.options import MOST_RUNS, Scheduler, StudyResults, Workers, number, text
from isogal.cli.tables import print_table

if TYPE_CHECKING:
    from isogal.paper.claims import Claim
    from isogal.paper.measure import Results


@with_groups
def paper(
    results: StudyResults,
    workers: Workers = None,
    scheduler: Scheduler = None,
    runs: Annotated[
        int, number("Runs of each case; the paper has 100.", "N", least=1, most=MOST_RUNS)
    ] = 100,
    map_: Annotated[
        str | None,
        text(
            "FILE",
            "File or folder with gravity and gravity disturbance; default: the synthetic map.",
            "--map",
        ),
    ] = None,
    duration: Annotated[
        float, number("Simulated time of each run.", "SECONDS", least=600.0)
    ] = 12960.0,
) -> None:
    """Redo section 4 of the paper: Tables 4 and 6, all figures, every claim.

    Writes report.html with all figures (PNG files beside it) and results.json. Finished runs are
    kept in DIR/runs: after Ctrl-C the same command goes on from there."""
    from isogal.montecarlo.progress import LiveProgress
    from isogal.montecarlo.study import Backend
    from isogal.paper.cases import Plan
    from isogal.paper.study import reproduce

    backend = Backend(workers, scheduler)
    plan = Plan(runs, None if map_ is None else str(Path(map_).expanduser()), duration)
    with ending_well(results.runs), LiveProgress("paper") as display:
        found, claims, page = reproduce(plan, results.out, backend, display)
    if results.json:
        typer.echo((results.out / "results.json").read_text(encoding="utf-8"), nl=False)
    else:
        _print(found, claims, page)


def _print(results: "Results", claims: "Sequence[Claim]", page: Path) -> None:
    from isogal.evaluation.html_report import number
    from isogal.paper.cases import MATCHERS
    from isogal.paper.published import ROWS

    rows = []
    for row in ROWS:
        cells = [row.quantity, f"{row.sigma:g}", f"{row.batch_length}"]
        cells += [number(row.mean_error), f"{row.divergence_rate:.0%}"]
        for matcher in MATCHERS:
            outcome = results.row(row, matcher)
            cells += [number(outcome.mean), f"{outcome.diverged / len(outcome.run_means):.0%}"]
        rows.append(cells)
    verdicts = [claim.verdict for claim in claims]
    found = ", ".join(
        f"{verdicts.count(v)} {v}" for v in ("holds", "does not hold", "cannot tell")
    )
    columns = [cell for name in ("paper", *MATCHERS) for cell in (name, "div.")]
    print_table(
        ("map", "sigma", "T", *columns),
        rows,
        f"{len(claims)} claims: {found}",
        str(page),
        title=f"Mean error (m) and diverged runs, {results.plan.runs} runs a case",
        words=range(3),
    )
