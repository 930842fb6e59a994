"""The view without a browser: session, server, files, notebooks, odd URDFs."""

import asyncio
import base64
import contextlib
import http.client
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.request
import warnings
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import urlsplit

import numpy as np
import pinocchio as pin
import pytest
import tornado.httpclient
import tornado.websocket
import umsgpack
from helpers.arms import frame, joint, link, load_text, robot, two_links, with_wheels

import spacearm as sa

with warnings.catch_warnings():  # meshcat imports what is deprecated
    warnings.simplefilter("ignore", DeprecationWarning)
    from spacearm.viewer import layers, pictures, stage
    from spacearm.viewer import viewer as pages
    from spacearm.viewer.readouts import joint_map
    from spacearm.viewer.session import Session
    from spacearm.viewer.shapes import shapes
    from spacearm.viewer.window import DELETE, Key, Outbox


BOX = '<visual><geometry><box size="1 1 1"/></geometry></visual>'


@pytest.fixture
def session():
    arm = sa.load("planar2")
    return Session(arm, arm.at([0.1, 0.2]))


@pytest.fixture
def viewer():
    viewer = sa.view(sa.load("planar2").at(np.radians([-65, -40])), open=False)
    yield viewer
    viewer.close()


# --- the session ----------------------------------------------------------------------------


def test_posture_mode_holds_the_attitude_and_floating_mode_lets_it_turn(session):
    session.handle({"do": "joint", "index": 0, "value": 1.0})
    assert np.allclose(session.cfg.base.rotation, np.eye(3))
    session.handle({"do": "mode", "mode": "free-floating"})
    before = session.cfg
    session.handle({"do": "joint", "index": 1, "value": 1.5})
    assert session.cfg.base.isApprox(sa.move(before, [1.0, 1.5]).base, 1e-12)
    assert not np.allclose(session.cfg.base.rotation, np.eye(3))


def test_home_random_and_attitude(session):
    session.handle({"do": "attitude", "rpy": [0.1, 0.2, 0.3]})
    assert session.readout()["attitude"] == pytest.approx([0.1, 0.2, 0.3])
    session.handle({"do": "random"})
    assert (session.cfg.q >= session.arm.lower).all()
    assert (session.cfg.q <= session.arm.upper).all()
    session.handle({"do": "home"})
    assert session.readout()["q"] == [0, 0]
    assert session.readout()["attitude"] == [0, 0, 0]
    assert session.readout()["kind"] == "kinematic"


def test_the_nearest_singularity_is_one_click_away(session):
    session.handle({"do": "nearest"})
    assert session.readout()["kind"] != "regular"
    assert session.readout()["sigma_min"] < 1e-10
    redundant = sa.load("chaser7")
    other = Session(redundant, redundant.at(np.full(7, 0.3)))
    other.handle({"do": "nearest"})
    assert other.report.sigma_min < 1e-9
    never = sa.load("planar2", task="z rx")
    with pytest.raises(sa.ConfigurationError, match="is singular here already"):
        Session(never, never.at([0.1, 0.2])).handle({"do": "nearest"})


def test_readout_is_the_report_and_the_code_is_the_configuration(session):
    session.handle({"do": "attitude", "rpy": [0.1, 0.2, 0.3]})
    readout, report = session.readout(), sa.singularity(session.cfg)
    assert readout["sigma"] == report.sigma.tolist()
    assert readout["radius"] == pytest.approx(
        np.linalg.norm(session.cfg.tip.translation - session.cfg.com)
    )
    names = {}
    exec(readout["python"], names)
    assert np.array_equal(names["cfg"].q, session.cfg.q)
    assert names["cfg"].base.isApprox(session.cfg.base, 1e-15)


@pytest.mark.parametrize(
    ("message", "error"),
    [
        ("home", "unknown message 'home'"),
        ([], "unknown message"),
        (None, "unknown message"),
        ({"do": "hover"}, "unknown message 'hover'; valid, nearest first"),
        ({"do": ["home"]}, "unknown message"),
        ({"do": "joint"}, "value is 'None'"),
        ({"do": "joint", "index": 2, "value": 0}, "joint index is 2; give 0 to 1"),
        ({"do": "joint", "index": -1, "value": 0}, "joint index is -1"),
        ({"do": "joint", "index": True, "value": 0}, "joint index is True"),
        ({"do": "joint", "index": 0, "value": "1"}, "value is '1'; give a finite number"),
        ({"do": "joint", "index": 0, "value": float("nan")}, "value is 'nan'"),
        ({"do": "joint", "index": 0, "value": 10**400}, "give a finite number"),
        (
            {"do": "joint", "index": 0, "value": 3.5},
            r"joint_1 at 200.54° is outside its range \(-180° to 180°\)",
        ),
        ({"do": "joints"}, "give lists of indices and values"),
        ({"do": "joints", "indices": [0], "values": []}, "1 indices and 0 values"),
        ({"do": "joints", "indices": [0, 1], "values": [1, 9]}, "joint_2 at .* is outside"),
        ({"do": "attitude", "rpy": [1, 2]}, "attitude is"),
        ({"do": "attitude", "rpy": [1, 2, None]}, "attitude is 'None'"),
        ({"do": "mode", "mode": "fast"}, "unknown mode 'fast'"),
        ({"do": "posture", "q": [1]}, r"q is '\[1\]'; give 2 numbers"),
        ({"do": "posture", "q": [1, 2], "base": [0] * 6}, "base is .* give 7 numbers"),
        ({"do": "posture", "q": [1, 2], "base": [0] * 6 + [2]}, "base: .* has no length 1"),
    ],
)
def test_malformed_messages_are_refused_and_change_nothing(session, message, error):
    before = session.readout()
    with pytest.raises(sa.ConfigurationError, match=error):
        session.handle(message)
    assert session.readout() == before


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lower", "upper", "ends"),
    [(-1e12, 1e12, (-25, 25)), (-1, 1e12, (-1, 25)), (1e3, 1e6, (1000, 1025)), (-2, 1, (-2, 1))],
)
@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.filterwarnings("ignore:.*look like degrees:spacearm.ModelWarning")
def test_sliders_end_where_the_spacecraft_can_be_followed(tmp_path, kind, lower, upper, ends):
    limit = f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/>'
    path = tmp_path / "r.urdf"
    path.write_text(robot(*two_links(kind=kind, inside=limit)))
    arm = sa.load(path)
    session = Session(arm, arm.at(np.clip([0.0], lower, upper)))
    assert np.ravel(session.range).tolist() == list(ends)
    session.handle({"do": "mode", "mode": "free-floating"})
    before = session.cfg
    session.handle({"do": "joint", "index": 0, "value": ends[1]})
    assert session.cfg.base.isApprox(sa.move(before, [ends[1]]).base)
    with pytest.raises(sa.ConfigurationError, match="outside its range"):
        session.handle({"do": "joint", "index": 0, "value": 1e7})


def test_a_way_that_is_too_long_is_not_followed(session):
    """Only Python shows such a configuration; then the page may ask to come home."""
    session.show(session.arm.at([1e9, 0.0]))
    session.handle({"do": "mode", "mode": "free-floating"})
    for message in ({"do": "home"}, {"do": "random"}, {"do": "joint", "index": 0, "value": 1}):
        with pytest.raises(sa.ConfigurationError, match=r"move by 1e\+09 .* switch to posture"):
            session.handle(message)
    session.handle({"do": "mode", "mode": "posture"})
    session.handle({"do": "home"})
    assert session.cfg.q.tolist() == [0, 0]


# --- the server -----------------------------------------------------------------------------


def socket_of(url):
    """Address of the socket of a page."""
    return url.replace("http", "ws", 1).replace("/?", "/socket?")


def port_of(url):
    return urlsplit(url).port


def get(url, path="", **headers):
    """Status of a GET request; the page itself, with its token, if no path is given."""
    parts = urlsplit(url)
    connection = http.client.HTTPConnection(parts.hostname, parts.port, timeout=60)
    try:
        connection.request("GET", f"/{path}?{parts.query}", headers=headers)
        with connection.getresponse() as answer:
            return answer.status
    finally:
        connection.close()


async def ended(ws):
    ws.close()
    while await ws.read_message() is not None:
        pass


async def exchange(url, *messages, answers=1, headers=None):
    """Opens a socket, sends, and returns the JSON messages that come back after the first ones."""
    request = tornado.httpclient.HTTPRequest(socket_of(url), headers=headers)
    ws = await tornado.websocket.websocket_connect(request)
    texts = []
    while "complete" not in (texts[-1] if texts else {}):
        message = await ws.read_message()
        texts += [json.loads(message)] if isinstance(message, str) else []
    texts.clear()
    for message in messages:
        await ws.write_message(message, binary=isinstance(message, bytes))
    while len(texts) < answers:
        message = await asyncio.wait_for(ws.read_message(), 10)
        texts += [json.loads(message)] if isinstance(message, str) else []
    await ended(ws)
    return texts


def talk(url, *messages, **options):
    return asyncio.run(exchange(url, *messages, **options))


def test_page_and_socket_answer(viewer):
    url = viewer.serve()
    assert url.startswith("http://127.0.0.1:")
    for name in ("", "page.css", "page.js", "scene.js", "meshcat.js"):
        assert get(url, name) == 200
    (answer,) = talk(url, json.dumps({"do": "joint", "index": 1, "value": -0.1991}))
    assert answer["readout"]["kind"] == "dynamic"
    first, _ = talk(url, json.dumps({"do": "map", "joints": [1, 0]}), answers=2)
    assert first["map"]["joints"] == [1, 0]


@pytest.mark.parametrize("path", ["", "page.js", "socket"])
def test_other_host_names_are_refused(viewer, path):
    url = viewer.serve()
    port = port_of(url)
    for host in ("evil.example", f"evil.example:{port}", f"127.0.0.1.evil.example:{port}"):
        assert get(url, path, Host=host) == 403


def test_other_origins_are_refused(viewer):
    """Whatever else the request says, with the right token, in either header and beside our own."""
    url = viewer.serve()
    own, host = url.partition("/?")[0], f"127.0.0.1:{port_of(url)}"
    assert talk(url, "{}")  # a program, which has no origin; it knows the token
    assert talk(url, "{}", headers={"Origin": own})
    assert talk(url, "{}", headers={"Origin": own, "Sec-WebSocket-Origin": own})
    evil = ["http://evil.example", "null", "", "https://127.0.0.1", "http://127.0.0.1:1"]
    for origin in (*evil, f"https://{host}", f"ftp://{host}", f"HTTP://{host}/", host):
        for headers in (
            {"Origin": origin},
            {"Sec-WebSocket-Origin": origin},
            {"Origin": own, "Sec-WebSocket-Origin": origin},
            {"Origin": origin, "Sec-Fetch-Site": "same-origin"},
            {"Origin": origin, "Sec-Fetch-Site": "none"},
        ):
            with pytest.raises(tornado.httpclient.HTTPClientError, match="403"):
                talk(url, "{}", headers=headers)


def test_files_outside_the_page_are_not_served(viewer):
    for path in (
        "saved.html",
        "ended.html",
        "index.html",
        "../viewer.py",
        "%2e%2e/viewer.py",
        "etc/passwd",
    ):
        assert get(viewer.serve(), path) == 404


@pytest.mark.parametrize(
    "text", ["{", "", "\ufffd", "[" * 50_000, "9" * 5000, "nan", '{"do": "dance"}', b"\xff\xfe"]
)
def test_malformed_text_is_answered_and_the_server_goes_on(viewer, text):
    url = viewer.serve()
    (answer,) = talk(url, text)
    assert answer["error"]
    assert "readout" in talk(url, '{"do": "home"}')[0]


@pytest.mark.slow
def test_a_thousand_rapid_messages_end_in_the_last_state(viewer):
    url = viewer.serve()
    values = np.linspace(-3, 3, 1000)
    texts = [json.dumps({"do": "joint", "index": 0, "value": v}) for v in values]

    async def flood():
        ws = await tornado.websocket.websocket_connect(socket_of(url))
        for text in texts:
            await ws.write_message(text)
        while True:
            message = await ws.read_message()
            assert message is not None
            if isinstance(message, str):
                readout = json.loads(message).get("readout", {})
                if readout.get("q", [None])[0] == values[-1]:
                    return await ended(ws)

    asyncio.run(asyncio.wait_for(flood(), 120))


def test_the_readout_comes_before_the_drawing(viewer):
    """A browser draws for longer than it shows numbers: these must not wait."""
    url = viewer.serve()

    async def kinds():
        ws = await tornado.websocket.websocket_connect(socket_of(url))
        while "complete" not in str(await ws.read_message()):
            pass
        await ws.write_message('{"do": "joint", "index": 0, "value": 0.5}')
        first, second = [await asyncio.wait_for(ws.read_message(), 10) for _ in range(2)]
        await ended(ws)
        return first, second

    first, second = asyncio.run(kinds())
    assert json.loads(first)["readout"]["q"][0] == 0.5
    assert isinstance(second, bytes)


def test_two_tabs_see_the_same(viewer):
    url = viewer.serve()

    async def both():
        ws = await tornado.websocket.websocket_connect(socket_of(url))
        await exchange(url, '{"do": "home"}')
        while True:
            message = await asyncio.wait_for(ws.read_message(), 10)
            readout = json.loads(message).get("readout", {}) if isinstance(message, str) else {}
            if readout.get("q") == [0, 0]:
                return await ended(ws)

    asyncio.run(both())


def test_only_loopback_is_bound(viewer):
    port = port_of(viewer.serve())
    with socket.socket() as everywhere:  # free on other addresses, so it can be bound there
        everywhere.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        everywhere.bind(("127.0.0.2", port))
    with pytest.raises(ConnectionRefusedError):
        get(f"http://127.0.0.2:{port}/")


def test_closing_frees_the_port_and_a_port_in_use_is_named(viewer):
    port = port_of(viewer.serve())
    other = sa.view(sa.load("planar2"), open=False)
    with pytest.raises(sa.SpaceArmError, match=f"port {port} of 127.0.0.1 is in use"):
        other.serve(port)
    with pytest.raises(sa.SpaceArmError, match=r"port 99999 .* not allowed"):
        other.serve(99999)
    free = other.serve()
    assert free != viewer.url
    viewer.close()
    assert viewer.url is None
    other.close()
    assert str(port) in other.serve(port)
    other.close()


# --- who gets in, and what they can take ------------------------------------------------------


@pytest.mark.parametrize("query", ["", "?token=", "?token=guess", "?token=%ff", "?token=ü"])
def test_whoever_lacks_the_token_gets_neither_page_nor_socket(viewer, query, capfd):
    port = port_of(viewer.serve())
    url = f"http://127.0.0.1:{port}/{query}".encode("ascii", "replace").decode()
    assert get(url) in (400, 403)
    with pytest.raises(tornado.httpclient.HTTPClientError, match=r"40[03]"):
        talk(url if query else f"{url}?", "{}")
    assert not capfd.readouterr().err


def test_each_server_has_a_token_of_its_own(viewer):
    first = viewer.serve()
    assert viewer.serve() == first
    viewer.close()
    port = port_of(first)
    other = sa.view(sa.load("planar3"), open=False)
    second = other.serve(port)
    try:
        assert port_of(second) == port
        assert second != first
        assert get(first) == 403
        assert get(second) == 200
        with pytest.raises(tornado.httpclient.HTTPClientError, match="403"):
            talk(first, "{}")
    finally:
        other.close()


def test_the_address_that_the_browser_is_started_with_leads_in_once(viewer, monkeypatch):
    """Other users see it in the list of processes."""
    opened = []
    monkeypatch.setattr(pages.webbrowser, "open", opened.append)
    viewer.open()
    (ticket,) = opened
    assert urlsplit(viewer.url).query not in ticket
    with urllib.request.urlopen(ticket, timeout=60) as answer:
        assert answer.url == viewer.url
        assert answer.status == 200
    assert get(ticket) == 403
    with pytest.raises(tornado.httpclient.HTTPClientError, match="403"):
        talk(ticket, "{}")


def test_an_outbox_keeps_the_latest_of_each_kind():
    box, node = Outbox(), ("spacearm", "shells", "0")
    for i in range(1000):
        box.put(Key((), "readout"), f"readout {i}")
        box.put(Key(node, "set_transform"), b"%d" % i)
        box.put(Key(node, "visible"), b"visible %d" % i)
    assert len(box) == 3
    box.put(Key(node[:2], DELETE), b"gone")
    box.put(Key(node, "set_object"), b"again")
    box.put(Key((), "drawn"), "drawn")
    box.put(Key(node, "visible"), b"")
    commands = b"\4\0\0\0gone\5\0\0\0again"
    taken = [box.take() for _ in range(5)]
    assert taken == ["readout 999", commands, "drawn", b"\0\0\0\0", None]
    for i in range(3):
        box.put(Key((), f"{i}"), bytes(50_000))
    assert [len(box.take()) for _ in range(3)] == [50_004] * 3, "meshes come one by one"


def resident():
    """Memory of this process [MB]."""
    with Path("/proc/self/statm").open() as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_browser_that_does_not_read_costs_no_memory(viewer):
    url = viewer.serve()
    parts = urlsplit(url)
    with socket.create_connection((parts.hostname, parts.port)) as deaf:
        deaf.sendall(
            f"GET /socket?{parts.query} HTTP/1.1\r\nHost: {parts.netloc}\r\nUpgrade: websocket\r\n"
            "Connection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
            "Sec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        for _ in range(6000):  # a minute at most
            if viewer._server._browsers:
                break
            time.sleep(0.01)
        (browser,) = viewer._server._browsers
        before = resident()
        for i in range(400):
            viewer.shells(np.linspace(1, 2, 30) + 1e-4 * i)
        time.sleep(1)
        assert len(browser._outbox) < 2 * len(viewer.window.commands()) + 10
        assert resident() - before < 30
        (answer,) = talk(url, '{"do": "home"}')  # others are served
        assert "readout" in answer


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_large_bodies_are_refused_before_they_are_read(viewer, capfd):
    parts, before = urlsplit(viewer.serve()), resident()
    block = b"x" * 2**20
    with contextlib.ExitStack() as stack:
        for _ in range(5):
            link = stack.enter_context(socket.create_connection((parts.hostname, parts.port)))
            link.settimeout(5)
            head = f"POST /?{parts.query} HTTP/1.1\r\nHost: {parts.netloc}\r\n"
            link.sendall(f"{head}Content-Length: 90000000\r\n\r\n".encode())
            with contextlib.suppress(OSError):
                for _ in range(20):
                    link.sendall(block)
        time.sleep(0.5)
        assert resident() - before < 30
    assert get(viewer.url) == 200
    assert not capfd.readouterr().err


@pytest.mark.parametrize(
    "request_line",
    [b"GET /\x9b31m\x1b[2J HTTP/1.1", b"GET /%9b%1b?token=\x9b HTTP/1.1", b"\x9b \x9b \x9b",
     b"GET /socket?token=\x1b]0;x HTTP/1.1", b"POST / HTTP/1.1", b"GET /?ticket=%ff HTTP/1.1"],
)  # fmt: skip
def test_what_others_ask_for_is_not_written_to_the_terminal(viewer, request_line, capfd):
    parts = urlsplit(viewer.serve())
    for host in (parts.netloc, "\x9b31m", "evil.example"):
        with socket.create_connection((parts.hostname, parts.port)) as link:
            link.sendall(request_line + b"\r\nHost: " + host.encode("latin-1") + b"\r\n\r\n")
            link.settimeout(10)
            with contextlib.suppress(OSError):
                link.recv(4096)
    assert capfd.readouterr() == ("", "")
    assert get(viewer.url) == 200


@pytest.mark.slow
def test_ctrl_c_ends_the_command_and_leaves_nothing():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-u", "-m", "spacearm", "view", "planar2", "--no-open", "--port"]
    run = subprocess.Popen(
        [*command, str(port)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # children of a script's background jobs are born deaf to Ctrl-C
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    line = run.stdout.readline()
    assert f"http://127.0.0.1:{port}/?token=" in line
    assert get(line.split()[1]) == 200
    run.send_signal(signal.SIGINT)
    _, errors = run.communicate(timeout=300)
    assert run.returncode == 0
    assert errors == ""
    with pytest.raises(ConnectionRefusedError):
        get(f"http://127.0.0.1:{port}/")


# --- what is drawn --------------------------------------------------------------------------


def test_every_link_is_drawn_even_without_visuals(tmp_path):
    path = tmp_path / "plain.urdf"
    path.write_text(
        robot(
            *two_links(),
            link("hand"),
            joint("wrist", "arm", "hand"),
            frame("tip"),
            joint("end", "hand", "tip", "fixed"),
        )
    )
    arm = sa.load(path)
    with pytest.warns(sa.ModelWarning, match="no visuals for bus, arm, hand") as caught:
        assert {shape.link for shape in shapes(arm)} == {"bus", "arm", "hand"}
    assert len(caught) == 1
    with pytest.warns(sa.ModelWarning):
        assert "BoxGeometry" in str(sa.view(arm, open=False).window.commands())


@pytest.mark.parametrize(
    ("content", "message"), [(b"not a mesh", "cannot be read"), (None, "meshes not found")]
)
@pytest.mark.parametrize("name", ["package://r/arm.stl", "arm.dae", "arm.xyz"])
def test_meshes_that_cannot_be_had_give_one_warning_and_a_scene(tmp_path, name, content, message):
    if content:
        (tmp_path / name.rpartition("/")[2]).write_bytes(content)
    mesh = f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
    _, _, elbow = two_links()
    path = tmp_path / "r.urdf"
    path.write_text(robot(link("bus", 50.0, inside=BOX), link("arm", inside=mesh), elbow))
    with pytest.warns(sa.ModelWarning, match=message) as caught:
        viewer = sa.view(sa.load(path), open=False)
    assert len([w for w in caught if issubclass(w.category, sa.ModelWarning)]) == 1
    assert b"CylinderGeometry" in b"".join(viewer.window.commands())


def test_meshes_are_drawn(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box().export(tmp_path / "arm.stl")
    mesh = '<visual><geometry><mesh filename="arm.stl" scale="2 1 1"/></geometry></visual>'
    bus, _, elbow = two_links()
    path = tmp_path / "r.urdf"
    path.write_text(robot(bus, link("arm", inside=mesh), elbow))
    with pytest.warns(sa.ModelWarning, match="no visuals for bus"):
        (shape,) = [s for s in shapes(sa.load(path)) if s.link == "arm"]
    assert len(shape.geometry.faces) == 12
    assert np.allclose(shape.pose, np.diag([2, 1, 1, 1]))


def test_prismatic_and_branched_arms_have_a_scene(tmp_path):
    path = tmp_path / "r.urdf"
    path.write_text(robot(*two_links(kind="prismatic"), link("p"), joint("wing", "bus", "p")))
    with pytest.warns(sa.ModelWarning, match="no visuals"):
        viewer = sa.view(sa.load(path, tip="arm", joints="all"), open=False)
    viewer.show([0.2, 0.3])
    assert viewer.session.cfg.q[0] == 0.2


def recorded(viewer, path, kind="visible"):
    key = Key(("spacearm", *path.split("/")), kind)
    return umsgpack.unpackb(viewer.window._scene[key])["value"]


def test_the_lost_direction_appears_at_the_singularity_only(viewer):
    assert not recorded(viewer, "directions/lost")
    viewer.show(np.radians([-65, -11.41]))
    assert recorded(viewer, "directions/lost")
    assert recorded(viewer, "directions/line")
    viewer.show(np.radians([-65, -13]))
    assert not recorded(viewer, "directions/lost")
    assert recorded(viewer, "directions/weak")


def test_layers_and_shells(viewer):
    viewer.shells([0.351, 2.287])
    viewer.layer("shells", False)
    assert recorded(viewer, "shells") is False
    assert viewer.readout()["hidden"] == ["shells"]
    with pytest.raises(sa.ConfigurationError, match="unknown layer 'shell'"):
        viewer.layer("shell", True)
    with pytest.raises(sa.ConfigurationError, match="shell radius is -1"):
        viewer.shells([-1])
    assert set(layers.LAYERS) == {"grid", "bodies", "centre of mass", "virtual manipulator",
                                 "tip frame", "ellipsoid", "directions", "shells", "risk", "trace",
                                 "attitudes", "obstacles", "target", "goal", "comparison",
                                 "wheels", "wrenches"}  # fmt: skip


def test_wheels_and_wrenches_are_drawn_while_they_act():
    wheel = link("disc", 1.0, inertia=np.diag([1.0, 1.0, 2.0]))
    spun = (wheel, joint("spin", "bus", "disc", xyz=(0, 0, 0.5), axis=(0, 0, 1)))
    arms = (link("upper", 5.0, (0.5, 0, 0)), joint("shoulder", "bus", "upper", xyz=(1, 0, 0)))
    text = robot(link("bus", 100.0, inertia=20.0 * np.eye(3)), *spun, *arms)
    arm = load_text(text, tip="upper", task="x", wheels=["spin"])
    law = sa.JointPD(target=[0.5], kp=1.0, kd=3.0)
    push = {"bus": lambda t: [0.0, 2.0 * (t < 1.0), 0.0, 0.0, 0.0, 0.0]}
    hold = sa.WheelHold(stiffness=50.0, damping=100.0)
    run = sa.simulate(
        arm.at([0.1]),
        law,
        4.0,
        plant=sa.Plant(wheels=hold, wrenches=push),
        integration=sa.Integration(dt=0.1),
    )
    with pytest.warns(sa.ModelWarning, match="no visuals"):
        viewer = sa.view(run, open=False)
    for t, pushed in ((0.5, True), (3.0, False)):
        viewer.handle({"do": "time", "t": t})
        viewer.draw()
        assert recorded(viewer, "wrenches/0/force") is pushed
        assert recorded(viewer, "wheels/0/arrow") is True
    curves = {group["name"]: group for group in viewer.about()["motion"]["curves"]}
    assert curves["force on bus"]["unit"] == "N"
    assert curves["force on bus"]["labels"] == ["x", "y", "z"]
    _, along_y, _ = curves["force on bus"]["values"]
    assert (along_y[0], along_y[-1]) == (2.0, 0.0)
    assert "torque on bus" not in curves, "there is none"
    viewer.close()


def test_the_window_keeps_only_what_matters(viewer):
    counts = []
    for _ in range(3):
        for q in np.linspace(0, 1, 20):
            viewer.show([q, q])
        counts.append(len(viewer.window.commands()))
    assert counts[0] == counts[1] == counts[2]


# --- files and notebooks --------------------------------------------------------------------


def test_saved_page_is_self_contained(viewer, tmp_path):
    path = viewer.save(tmp_path / "scene ü.html")
    text = path.read_text(encoding="utf-8")
    assert "<title>planar2 - spacearm</title>" in text
    assert "%%" not in text.replace("%%%", "")
    body = text[text.index("</script>") :]  # after the viewer's own source
    assert "http" not in body
    assert not [f for f in tmp_path.iterdir() if f != path], "nothing half-written is left"


def test_saving_where_nothing_can_be_written_says_so(viewer, tmp_path):
    with pytest.raises(sa.SpaceArmError, match=r"nowhere.* cannot be written: No such file"):
        viewer.save(tmp_path / "nowhere" / "scene.html")


def test_a_picture_without_a_browser_says_what_to_install(viewer, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(sa.SpaceArmError, match="apt-get install chromium"):
        viewer.png(tmp_path / "scene.png")


def test_a_motion_is_saved_with_its_animation():
    arm = sa.load("planar2")
    cfgs = [arm.at([0.0, 0.5])]
    cfgs.append(sa.move(cfgs[0], [1.0, 1.5]))
    motion = sa.Motion.of(
        SimpleNamespace(arm=arm, t=[0, 1], q=[c.q for c in cfgs], base=[c.base for c in cfgs])
    )
    viewer = sa.view(motion, open=False)
    viewer.handle({"do": "time", "t": 0.5})
    assert np.allclose(viewer.session.cfg.q, [0.5, 1.0])
    with pytest.raises(sa.ConfigurationError, match="time is"):
        viewer.handle({"do": "time", "t": "x"})
    text = viewer.html()
    assert '"span": [0.0, 1.0]' in text
    assert b"set_animation" in b"".join(viewer.window.commands())


@pytest.mark.slow
def test_a_saved_page_has_the_maps_of_its_motion(monkeypatch):
    """One where no other joint moves; along the motion where others do; none of sliding joints."""
    monkeypatch.setattr(stage, "MOST_MAPS", 3)
    base = [pin.SE3.Identity()] * 2
    for arm, times in ((sa.load("planar2"), [0.0]), (sa.load("mda6"), [0.0, 2.0, 4.0])):
        q = np.array([np.full(arm.n, 0.4), np.full(arm.n, 0.6)])
        run = sa.Motion.of(SimpleNamespace(arm=arm, t=[0, 4], q=q, base=base))
        viewer = sa.view(run, open=False)
        data = json.loads(re.search(r"const DATA = (.*);", viewer.html())[1])
        assert [there["t"] for there in data["maps"]] == times
        for there in data["maps"]:
            assert there == {"t": there["t"], **joint_map(run.at(there["t"]), None)}
    slides = load_text(robot(*two_links(kind="prismatic")))
    with pytest.warns(sa.ModelWarning, match="no visuals"):
        assert '"maps": []' in sa.view(slides.at(np.zeros(slides.n)), open=False).html()


@pytest.mark.parametrize(("end", "step"), [(1.01, 1.01 / 16), (1e12, 1e12 / 59)])
def test_a_long_motion_is_thinned_evenly(monkeypatch, end, step):
    """At least 15 frames a second, as long as they are not too many; the last is the end."""
    monkeypatch.setattr(stage, "MOST_FRAMES", 60)
    base = [pin.SE3.Identity()] * 2
    motion = SimpleNamespace(arm=sa.load("planar2"), t=[0, end], q=[[0, 0], [1, 2]], base=base)
    viewer = sa.view(sa.Motion.of(motion), open=False)
    viewer.html()
    commands = [umsgpack.unpackb(command) for command in viewer.window.commands()]
    (clips,) = [c["animations"] for c in commands if c["type"] == "set_animation"]
    tracks = [track["keys"] for clip in clips for track in clip["clip"]["tracks"]]
    times = [key["time"] for key in max(tracks, key=len)]
    np.testing.assert_allclose(np.diff(times), 15 * step, rtol=1e-9, atol=0)
    assert times[-1] == pytest.approx(15 * end)


def test_pictures_are_joined_of_pieces_between_what_else_a_browser_tells():
    """Some of them end with a whole piece, after which only the mark of their end comes."""
    rng = np.random.default_rng(0)
    drawn = [rng.bytes(n) for n in (2250, 4500, 4501, 7)]
    lines = []
    for picture in drawn:
        text = base64.b64encode(picture).decode() + "!"
        for at in range(0, len(text), 3000):
            lines += [
                f'[1:CONSOLE:7] "picture {text[at : at + 3000]}", source: a.html (7)\n',
                "GPU\n",
            ]
    assert list(pictures._joined(line.encode() for line in lines)) == drawn


def test_a_browser_that_does_not_end(viewer, tmp_path, monkeypatch):
    browser = tmp_path / "chromium"
    browser.write_text("#!/bin/sh\nexec sleep 60\n")
    browser.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    monkeypatch.setattr(pictures, "RENDERING", 0.2)
    with pytest.raises(sa.SpaceArmError, match=r"has not drawn the picture after 0.2 s; use .save"):
        viewer.png(tmp_path / "scene.png")


def test_bad_input_to_view():
    with pytest.raises(sa.ConfigurationError, match="a str cannot be shown; give a SpaceArm"):
        sa.view("planar2", open=False)
    with pytest.raises(sa.ConfigurationError, match=r"q has shape \(3,\)"):
        sa.view(sa.load("planar2").at([1, 2, 3]), open=False)


def test_view_starts_inside_the_limits():
    viewer = sa.view(sa.load("planar2"), open=False)
    assert (np.abs(viewer.session.cfg.q) < np.pi).all()
    assert "planar2" in repr(viewer)
    assert isinstance(viewer.session.cfg.base, pin.SE3)


@pytest.mark.slow
def test_the_command_writes_a_page(tmp_path):
    command = [sys.executable, "-m", "spacearm", "view", "planar2", "--deg", "-65", "-11.41"]
    run = subprocess.run(
        [*command, "--save", tmp_path / "a.html"],
        capture_output=True, text=True, check=False, env=os.environ | {"COLUMNS": "200"},
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert (tmp_path / "a.html").stat().st_size > 800_000


# --- choices of the page ----------------------------------------------------------------------


def described():
    bus, arm, elbow = two_links()
    return robot(bus, arm, elbow, frame("tip"), joint("end", "arm", "tip", "fixed"))


def test_the_page_chooses_arm_tip_task_and_joints(viewer):
    viewer.handle({"do": "arm", "robot": "mda6"})
    assert (viewer.session.arm.name, viewer.readout()["edition"]) == ("mda6", 1)
    assert viewer.session.report.kind == "regular"
    names = viewer.session.arm.joint_names
    q = viewer.q
    viewer.handle({"do": "arm", "task": "position"})
    assert viewer.session.arm.task.rows == ("x", "y", "z")
    assert np.array_equal(viewer.q, q), "the same joints stay where they are"
    viewer.handle({"do": "arm", "joints": list(names[:4])})
    assert viewer.session.arm.joint_names == names[:4]
    loaded = {}
    exec(viewer.readout()["python"], loaded)
    assert loaded["arm"].joint_names == names[:4]
    np.testing.assert_allclose(
        loaded["cfg"].tip.homogeneous, viewer.configuration.tip.homogeneous, atol=1e-12
    )
    assert viewer.about()["choices"]["joints"] == list(names)
    viewer.handle({"do": "arm", "joints": list(names)})
    assert viewer.session.arm.joint_names == names
    viewer.handle({"do": "arm", "tip": "link_3"})
    assert viewer.session.arm.tip == "link_3"
    loaded = {}
    exec(viewer.readout()["python"], loaded)
    assert loaded["arm"].tip == "link_3"
    assert b"link_6" in b"".join(viewer.window.commands())


@pytest.mark.parametrize(
    "changed",
    [{"locked": {"joint_2": 0.3}}, {"payload": 5.0}, {"task": sa.Task("pose", length=2.0)}],
)
def test_code_says_that_it_lacks_what_was_changed_in_python(changed):
    arm = sa.load("mda6")
    for one, is_said in ((arm, False), (arm.replace(**changed), True)):
        code = Session(one, one.at(np.full(one.n, 0.5))).readout()["python"]
        assert code.startswith("# without what was changed in Python") is is_said


def test_code_brings_wheels_and_momentum_back(tmp_path):
    path = tmp_path / "wheels.urdf"
    path.write_text(with_wheels("planar2", [(0, 0, 1)], mark=""), encoding="utf-8")
    arm = sa.load(path, wheels={"wheel_0": (0.3, 2.0)})
    cfg = arm.at([0.3, 1.2], momentum=[0, 0, 0, 0, 0, 1.0], wheels=[0.5])
    code, loaded = Session(arm, cfg).readout()["python"], {}
    assert "without what" not in code
    exec(code, loaded)
    (wheel,) = loaded["arm"].wheels
    assert (wheel.name, wheel.torque, wheel.capacity) == ("wheel_0", 0.3, 2.0)
    np.testing.assert_array_equal(loaded["cfg"].momentum, cfg.momentum)
    np.testing.assert_array_equal(loaded["cfg"].wheels, cfg.wheels)


def test_what_an_address_has_brings_arm_and_posture_back(viewer):
    names = sa.load("mda6").joint_names
    options = {"tip": "link_6", "task": "position", "joints": list(names[1:])}
    for message in (
        {"do": "arm", "robot": "mda6", **options},
        {"do": "mode", "mode": "free-floating"},
        {"do": "random"},
    ):
        viewer.handle(message)
    wanted, arm = viewer.readout(), viewer.about()["choices"]
    assert arm["robot"] == "mda6"
    assert list(arm["locked"]) == [names[0]]
    viewer.handle({"do": "arm", "robot": "planar2"})
    chosen = {"robot": arm["robot"], "tip": "link_6", "task": arm["task"]}
    chosen |= {"joints": arm["counted"], "locked": {names[0]: 0.4}}
    viewer.handle({"do": "arm", **chosen})
    assert viewer.session.origin.locked == {names[0]: 0.4}
    viewer.handle({"do": "arm", **chosen, "locked": arm["locked"]})
    viewer.handle({"do": "posture", "q": wanted["q"], "base": wanted["base"]})
    got = viewer.readout()
    for name in ("q", "base", "sigma"):
        np.testing.assert_allclose(got[name], wanted[name], atol=1e-12)
    assert [got[name] for name in ("spacecraft", "mode", "kind")] == [
        wanted[name] for name in ("spacecraft", "mode", "kind")
    ]


@pytest.mark.filterwarnings("ignore::spacearm.ModelWarning")
def test_a_file_that_is_dropped_is_read_with_all_checks(viewer):
    viewer.handle({"do": "arm", "file": {"name": "../my robot.urdf", "text": described()}})
    assert viewer.session.arm.tip == "tip"
    note = viewer.readout()["note"]
    assert note.startswith("my_robot.urdf: the task 'x y' is impossible at every posture")
    line = next(one for one in viewer.readout()["python"].splitlines() if "sa.load" in one)
    assert "sa.load('my robot.urdf'" in line
    assert "the file dropped on the page" in line
    commands = viewer.window.commands()
    heavy = described().replace('<mass value="', '<mass value="-')
    for text, error in ((heavy, "mass"), ("<robot", "is not XML"), ("", "is not XML")):
        with pytest.raises(sa.SpaceArmError, match=f"^an arm.urdf: .*{error}"):
            viewer.handle({"do": "arm", "file": {"name": "an arm.urdf", "text": text}})
    assert viewer.window.commands() == commands
    assert viewer.readout()["edition"] == 1
    mesh = '<visual><geometry><mesh filename="no.stl"/></geometry></visual></link>'
    drawn = described().replace("</link>", mesh, 1)
    viewer.handle({"do": "arm", "file": {"name": "an arm.urdf", "text": drawn}})
    assert viewer.readout()["note"].startswith("an_arm.urdf: meshes not found")


@pytest.mark.parametrize(
    ("message", "error"),
    [
        ({"robot": "nobody"}, "unknown robot 'nobody'"),
        ({"robot": "../../etc/passwd"}, "unknown robot"),
        ({"robot": ["planar2"]}, "unknown robot"),
        ({"tip": 3}, "tip is '3'; give a text"),
        ({"tip": "nowhere"}, "nowhere"),
        ({"task": "fly"}, "fly"),
        ({"joints": "all of them"}, "give a list of names"),
        ({"joints": ["no_joint"]}, "no_joint"),
        ({"joints": ["joint_1"], "locked": [1]}, "give values by joint"),
        ({"joints": ["joint_1"], "locked": {"joint_2": "1"}}, "locked joint is '1'"),
        ({"file": "x"}, "give its name and its text"),
        ({"file": {"name": "a.py", "text": "import os"}}, r"'a.py' is none of .urdf"),
        ({"file": {"name": "a.urdf", "text": 3}}, "give its name and its text"),
    ],
)
def test_choices_that_cannot_be_are_refused_and_change_nothing(viewer, message, error):
    before, commands = viewer.readout(), viewer.window.commands()
    with pytest.raises(sa.SpaceArmError, match=error):
        viewer.handle({"do": "arm", **message})
    assert viewer.readout() == before
    assert viewer.window.commands() == commands


def test_a_server_is_closed_while_another_scene_is_drawn():
    viewer = sa.view(sa.load("planar2"), open=False)
    viewer.serve()
    with viewer.window.replaced():
        viewer.close()
    assert viewer.window.listeners == []
