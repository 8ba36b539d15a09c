"""The one exception that means "the user gave something that cannot be used"."""


class InputError(ValueError):
    """Bad input from a user: one clear line that names the file or field and what is allowed.

    The command line prints the message and exits with status 2; nodes refuse the parameter or drop
    the message."""
