"""The one exception that is meant for people."""


class SoftprintError(Exception):
    """Something the user can put right: the message says what was wrong, where, and what would be right.

    The command line prints it as one sentence and exits with a non-zero status; a traceback means a bug.
    """
