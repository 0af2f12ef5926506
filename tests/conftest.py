"""What all tests share: generated cases are the same in every run, and no case is judged by the clock."""

from hypothesis import settings

settings.register_profile("crunch", derandomize=True, deadline=None)
settings.load_profile("crunch")
