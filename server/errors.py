"""What a person can mend: a wrong file, name or setting. The command line prints it as one line and exits with 2."""

from __future__ import annotations


class UserError(Exception):
    """One line that names the place and the remedy."""

    def __str__(self) -> str:
        """The message on a single line, whatever was put into it."""
        return " ".join(super().__str__().split())
