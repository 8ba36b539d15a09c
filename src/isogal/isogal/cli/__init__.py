"""The command line: one module per command, mounted by `isogal.cli.main` when it is asked for."""
