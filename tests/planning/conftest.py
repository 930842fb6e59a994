"""Searches in these tests count the processor's time: a busy machine ends none of them sooner."""

import time
from types import SimpleNamespace

import pytest


@pytest.fixture(autouse=True)
def own_time(request, monkeypatch):
    if request.path.stem != "test_search":  # which is about that time
        clock = SimpleNamespace(monotonic=time.process_time)
        monkeypatch.setattr("spacearm.planning.account.time", clock)
