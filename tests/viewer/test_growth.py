"""What a viewer keeps does not grow with its use: objects are counted, nothing is timed."""

import asyncio
import gc
import json
import time
import warnings
from collections import Counter
from types import SimpleNamespace

import pytest
from tornado.websocket import WebSocketHandler, websocket_connect

import spacearm as sa

with warnings.catch_warnings():  # meshcat imports what is deprecated
    warnings.simplefilter("ignore", DeprecationWarning)
    from spacearm.viewer import server
    from spacearm.viewer.layers import LoadLayer
    from spacearm.viewer.motions import Comparison, HandFlight
    from spacearm.viewer.session import Session
    from spacearm.viewer.stage import Recorder, Scene, Stage

COUNTED = (
    Session, Stage, Scene, LoadLayer, Recorder, Comparison, HandFlight, WebSocketHandler,
)  # fmt: skip
FLIGHT = {"do": "fly", "twist": [0.01, 0.02, 0, 0, 0, 0], "dt": 0.1, "frame": "tip"}
REQUESTS = (
    {"do": "arm", "robot": "planar3"},
    {"do": "grab", "grip": 1, "shift": [0.01, 0, 0]},
    FLIGHT,
    FLIGHT,
    {"do": "land"},
    {"do": "poses"},
    {"do": "compare", "with": "fixed"},
    {"do": "time", "t": 0.1},
    {"do": "arm", "robot": "planar2"},
    {"do": "arm", "robot": "none"},
)


def counted():
    """What is counted of all objects of this process, those of other tests' viewers too."""
    gc.collect()
    return [one for one in gc.get_objects() if isinstance(one, COUNTED)]


@pytest.fixture
def others():
    """What other tests of this process have left; named before the viewer, it comes first."""
    return counted()


@pytest.fixture
def viewer():
    viewer = sa.view(sa.load("planar2"), open=False)
    yield viewer
    viewer.close()


def test_invitations_that_nobody_used_are_forgotten_when_they_expire(viewer, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(server, "time", SimpleNamespace(monotonic=lambda: now[0]))
    viewer.serve()
    for _ in range(3):
        viewer._repr_html_()
    assert len(viewer._server._tickets) == 3
    now[0] = 0.5 * server.PATIENCE
    used = viewer._server.invitation().partition("ticket=")[2]
    now[0] = 1.2 * server.PATIENCE
    viewer._server.invitation()
    assert len(viewer._server._tickets) == 2
    assert viewer._server.redeem(used)
    assert len(viewer._server._tickets) == 1


async def use(url):
    """Do all requests by a connection of its own, then leave."""
    socket = await websocket_connect(url.replace("http", "ws", 1).replace("/?", "/socket?"))
    for request in (None, *REQUESTS):
        if request:
            await socket.write_message(json.dumps(request))
        while "readout" not in str(await socket.read_message()):
            pass
    socket.close()
    while await socket.read_message() is not None:
        pass


def alive(viewer, others):
    """What is there besides the others once the server has noticed that nobody is connected."""
    left_out = {id(one) for one in others}

    def count():
        return Counter(type(one).__name__ for one in counted() if id(one) not in left_out)

    deadline = time.monotonic() + 60
    while viewer._server._browsers or count()["_Socket"]:  # the loop may still know the last one
        assert time.monotonic() < deadline
        time.sleep(0.05)
    return count()


@pytest.mark.slow
def test_what_connections_robots_and_motions_leave_is_given_up(others, viewer):
    url = viewer.serve()
    found, nodes = [], []
    for _ in range(3):
        asyncio.run(use(url))
        found.append(alive(viewer, others))
        nodes.append(len(viewer.window.commands()))
    assert found[2] == found[1]
    assert found[-1]["Session"] == found[-1]["Stage"] == found[-1]["Scene"] == 1
    assert nodes[-1] == nodes[0]
