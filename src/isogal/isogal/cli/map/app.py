"""The commands of ``isogal map``."""

import typer

from isogal.cli.map.fetch import fetch
from isogal.cli.map.info import info, variability
from isogal.cli.map.navigability import navigability
from isogal.cli.map.writing import continue_, convert, grid, synth

app = typer.Typer(
    no_args_is_help=True, add_completion=False, help="Look at maps, make, fetch and convert them."
)
for _command in (info, variability, synth, fetch, convert, grid, navigability):
    app.command()(_command)
app.command("continue")(continue_)
