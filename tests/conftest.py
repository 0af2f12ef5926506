"""What all tests share: generated cases are the same in every run, none is judged by the clock; the boards' builds."""

import pytest
from hypothesis import settings

from firmware.virtual import BUILDS
from tests.firmware.avr_tools import need_simavr

settings.register_profile("crunch", derandomize=True, deadline=None)
settings.load_profile("crunch")


@pytest.fixture(params=BUILDS)
def build(request):
    """Both builds of the virtual robot's boards, one after the other."""
    if request.param == "avr":
        need_simavr()
    return request.param
