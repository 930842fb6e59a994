"""Settings of all tests: no time limit for one example, since the first one loads packages."""

from hypothesis import settings

settings.register_profile("spacearm", deadline=None, derandomize=True)
settings.load_profile("spacearm")
