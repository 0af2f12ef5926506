"""Tools that a test cannot do without: on a developer's machine it is left out, in CI what is missing is a failure."""

import os
from typing import NoReturn

import pytest


def miss(what: str) -> NoReturn:
    """Skip the test for want of a tool, or fail where `make setup` must have installed it."""
    if os.environ.get("CI"):
        pytest.fail(f"{what}; in CI every tool must be there", pytrace=False)
    pytest.skip(what)
