"""The start of the program ``isogal``. Nothing is imported before Ctrl-C ends it with one line."""

from isogal.cli.errors import clean_errors, remember_interrupts


@clean_errors
def main() -> None:
    """Entry point of the console script."""
    remember_interrupts()
    from isogal.cli.main import main as program

    program()
