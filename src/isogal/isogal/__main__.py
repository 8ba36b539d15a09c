"""``python -m isogal``: the program ``isogal``."""

from isogal.cli.start import main

if __name__ == "__main__":
    main()
