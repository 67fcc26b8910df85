"""Who comes in to the page: secrets, cookies, host, origin, certificates, HTTPS beyond loopback."""

import asyncio
import ssl
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

import pytest
from aiohttp import ClientSession, TCPConnector, web
from aiohttp.test_utils import TestClient, TestServer
from telerobot.config.errors import ConfigError
from telerobot.config.load import load_cell
from telerobot.drivers.network.authority import Authority
from telerobot.drivers.network.identity import identity_of
from telerobot.protocols.roles import Grant
from telerobot.protocols.topics import Role
from telerobot.tools.client.operator import OperatorError
from telerobot.tools.host.address import moved
from telerobot.tools.operator.web import cli
from telerobot.tools.operator.web.pages import PageHub
from telerobot.tools.operator.web.server import (
    DEADLINE_S,
    LOGIN,
    MOST,
    WELCOME,
    Access,
    Doorkeeper,
    Listen,
    Server,
    same_origin,
    tls_context,
)
from yarl import URL


def nobody():
    raise OperatorError("no_daemon", "nobody answers")


def visit(steps):
    """Run `steps(client, access, origin)` against a server of the cell pa10, without a daemon."""

    async def run():
        access = Access("pa10")
        listen = Listen("127.0.0.1", 0)
        server = Server(load_cell("pa10"), PageHub(nobody), access, listen, secure=False)
        async with TestClient(TestServer(server.application())) as client:
            server.port = client.port
            await steps(client, access, f"http://{client.host}:{client.port}")

    asyncio.run(run())


def test_a_secret_opens_the_page_and_leaves_a_cookie_in_its_place():
    async def steps(client, access, origin):
        assert (await client.get("/")).status == 401
        assert (await client.get("/?key=guess")).status == 401
        came = await client.get("/", params={"key": access.keys[Role.OPERATOR]})
        assert came.status == 200
        assert "url=/" in await came.text()
        assert access.keys[Role.OPERATOR] not in await came.text()
        page = await client.get("/")
        assert page.status == 200
        assert "app.js" in await page.text()
        assert "'unsafe-inline'" not in page.headers["Content-Security-Policy"]
        assert page.headers["Content-Security-Policy"].startswith(
            "default-src 'none'; script-src 'self'"
        )

    visit(steps)


def test_the_form_of_the_login_is_heard_from_its_own_page_only():
    async def steps(client, access, origin):
        key = {"key": access.keys[Role.OBSERVER]}
        assert (await client.post("/login", data=key)).status == 403
        foreign = {"Origin": "http://evil.example"}
        assert (await client.post("/login", data=key, headers=foreign)).status == 403
        assert (await client.post("/login", data=key, headers={"Origin": origin})).status == 200
        assert (await client.get("/catalogue.json")).status == 200

    visit(steps)


def test_another_name_of_the_host_leads_nowhere():
    async def steps(client, access, origin):
        key = {"key": access.keys[Role.OPERATOR]}
        reply = await client.get("/", params=key, headers={"Host": "evil.example:80"})
        assert reply.status == 421
        assert "Set-Cookie" not in reply.headers

    visit(steps)


def test_a_socket_is_opened_by_the_page_itself_and_says_who_one_is():
    async def steps(client, access, origin):
        await client.get("/", params={"key": access.keys[Role.OBSERVER]})
        for headers in ({}, {"Origin": "http://evil.example"}):
            assert (await client.get("/ws", headers=headers)).status == 403
        async with client.ws_connect("/ws?name=eve", headers={"Origin": origin}) as socket:
            link = await socket.receive_json()
            assert (link["type"], link["you"], link["role"]) == ("link", "eve", "observer")

    visit(steps)


def test_what_lies_beside_the_page_is_not_served():
    async def steps(client, access, origin):
        await client.get("/", params={"key": access.keys[Role.OPERATOR]})
        for path in ("/../cli.py", "/..%2fcli.py", "/meshes/../../cli.py", "/package.json"):
            assert (await client.get(path)).status == 404

    visit(steps)


def test_cookies_and_keys_of_bytes_that_are_no_text_open_nothing_and_raise_nothing():
    async def steps(client, access, origin):
        for cookie in ("\udcff", "\u20ac", "a" * 3000):
            headers = {"Cookie": f"telerobot-{client.port}={cookie}"}
            assert (await client.get("/scene.json", headers=headers)).status == 401
        for key in ("%ff", "%ed%a0%80", "%00"):
            assert (await client.get(URL(f"/?key={key}", encoded=True))).status == 401

    visit(steps)
    assert Access("pa10").role_of_key("\udcff") is None


def test_a_page_that_floods_is_shown_out_and_the_others_are_not(caplog):
    async def steps(client, access, origin):
        await client.get("/", params={"key": access.keys[Role.OBSERVER]})
        async with (
            client.ws_connect("/ws?name=eve", headers={"Origin": origin}) as flood,
            client.ws_connect("/ws?name=ann", headers={"Origin": origin}) as other,
        ):
            with suppress(ConnectionError):
                for _ in range(3000):
                    await flood.send_str('{"type": "beat"}')
            while not flood.closed:
                await flood.receive()
            await other.send_str('{"type": "beat", "n": 5}')
            while (await other.receive_json()).get("n") != 5:
                pass

    visit(steps)
    assert not caplog.records


def test_cookies_and_secrets_of_one_role_do_not_open_the_other():
    access = Access("pa10")
    assert access.role_of_cookie(access.cookie(Role.OBSERVER)) is Role.OBSERVER
    assert access.role_of_cookie(access.cookie(Role.OPERATOR)) is Role.OPERATOR
    assert access.role_of_cookie(access.keys[Role.OPERATOR]) is None
    assert access.role_of_key("") is None
    assert Access("pa10").role_of_cookie(access.cookie(Role.OPERATOR)) is None


@pytest.mark.parametrize(
    ("uris", "role"),
    [
        (("telerobot:pa10/operator",), Role.OPERATOR),
        (("telerobot:pa10/observer",), Role.OBSERVER),
        (("telerobot:ur5e/operator", "telerobot:pa10/observer"), Role.OBSERVER),
        (("telerobot:pa10/rig",), None),
        (("telerobot:pa10/sensor/vision",), None),
        ((), None),
    ],
)
def test_a_certificate_has_the_role_that_it_grants_in_this_cell(uris, role):
    shown = {"subjectAltName": tuple(("URI", uri) for uri in uris)}
    assert Access("pa10").role_of_certificate(shown) is role
    assert Access("pa10").role_of_certificate(None) is None


@pytest.mark.parametrize(
    ("text", "beyond"),
    [("127.0.0.1:8080", False), ("localhost:80", False), ("[::1]:0", False), ("0.0.0.0:80", True),
     ("10.0.0.7:8080", True), ("arm.example:443", True)],
)  # fmt: skip
def test_beyond_loopback_is_known(text, beyond):
    assert Listen.parse(text).beyond is beyond


@pytest.mark.parametrize("text", ["8080", ":8080", "127.0.0.1", "127.0.0.1:http", "h:70000"])
def test_an_address_that_is_none_is_refused_in_one_line(text):
    with pytest.raises(ConfigError, match=r"--listen: value .*: write HOST:PORT"):
        Listen.parse(text)


def test_beyond_loopback_without_a_certificate_the_console_does_not_start():
    with pytest.raises(ConfigError, match="HTTPS"):
        tls_context("pa10", None, None, None)


@pytest.mark.parametrize(
    ("origin", "same"),
    [("http://127.0.0.1:8080", True), ("https://127.0.0.1:8080", False), (None, False),
     ("null", False), ("http://127.0.0.1:8081", False), ("http://127.0.0.1:8080.evil", False)],
)  # fmt: skip
def test_an_origin_is_the_same_only_in_scheme_host_and_port(origin, same):
    assert same_origin(origin, "http", "127.0.0.1:8080") is same


def test_beyond_loopback_a_certificate_of_the_cell_logs_in_over_https(tmp_path):
    authority = Authority.make(tmp_path, datetime.now(UTC))
    holders = {"operator-console": Role.OPERATOR, "observer-eve": Role.OBSERVER}
    for name, role in {**holders, "daemon-pa10": Role.DAEMON}.items():
        hosts = ["127.0.0.1"] if role is Role.DAEMON else []
        authority.certify(name, [Grant("pa10", role)], hosts, datetime.now(UTC), 30)

    async def run():
        cell = moved(load_cell("pa10"), endpoint="tls/127.0.0.1:7447", identity=tmp_path)
        identity = identity_of(cell, Role.OPERATOR, "console")
        listen = Listen("0.0.0.0", 0)
        server = Server(cell, PageHub(nobody), Access("pa10"), listen, secure=True)
        runner = web.AppRunner(server.application())
        await runner.setup()
        site = web.TCPSite(
            runner, "127.0.0.1", 0, ssl_context=tls_context("pa10", identity, None, None)
        )
        await site.start()
        url = f"https://127.0.0.1:{runner.addresses[0][1]}"
        shown = ssl.create_default_context(cafile=tmp_path / "authority.crt")
        async with ClientSession(connector=TCPConnector(ssl=shown)) as stranger:
            assert (await stranger.get(f"{url}/")).status == 401
        shown.load_cert_chain(tmp_path / "observer-eve.crt", tmp_path / "observer-eve.key")
        async with ClientSession(connector=TCPConnector(ssl=shown)) as eve:
            assert (await eve.get(f"{url}/")).status == 200
            async with eve.ws_connect(f"{url}/ws", headers={"Origin": url}) as socket:
                assert (await socket.receive_json())["role"] == "observer"
        await runner.cleanup()

    asyncio.run(run())


@pytest.mark.parametrize("page", [LOGIN, WELCOME])
def test_a_page_that_only_leads_on_asks_for_no_icon(page):
    """A browser asks for `/favicon.ico` where none is named, and complains that there is none."""
    assert '<link rel="icon" href="data:,">' in page


@pytest.mark.parametrize("origin", ["http://[::1", "http://[", "//[", "null", "http://[::1]]"])
def test_an_origin_that_is_no_address_is_another_origin(origin):
    assert not same_origin(origin, "http", "127.0.0.1:8080")

    async def steps(client, access, _origin):
        await client.get("/", params={"key": access.keys[Role.OPERATOR]})
        for path, method in (("/login", client.post), ("/ws", client.get)):
            reply = await method(path, headers={"Origin": origin})
            assert reply.status == 403

    visit(steps)


@pytest.mark.parametrize(
    "keys", [",", "", "a,b", "x" * 40, f"{'x' * 15},{'y' * 40}", "x" * 40 + ","]
)
def test_a_secret_that_can_be_guessed_is_refused_and_not_told(keys, monkeypatch):
    monkeypatch.setenv(cli.KEYS, keys)
    with pytest.raises(ConfigError, match="must be at least 16") as caught:
        cli._access("pa10")
    assert str(caught.value).startswith(f"{cli.KEYS}: the o")
    assert "xxx" not in str(caught.value)
    monkeypatch.setenv(cli.KEYS, f"{'x' * 16},{'y' * 16}")
    assert cli._access("pa10").role_of_key("x" * 16) is Role.OPERATOR
    assert cli._access("pa10").role_of_key("") is None


def test_the_secret_stands_on_no_browsers_command_line(monkeypatch):
    opened = []
    monkeypatch.setattr(cli.webbrowser, "open", opened.append)
    cli.open_page("http://127.0.0.1:8080/?key=very-secret")
    (address,) = opened
    assert "secret" not in address
    page = Path(URL(address).path)
    assert "url=http://127.0.0.1:8080/?key=very-secret" in page.read_text()
    assert page.parent.stat().st_mode & 0o077 == 0


class Connection:
    """A connection from an address, open until it is aborted."""

    def __init__(self, host):
        self._peer, self.open = (host, 1234), True

    def get_extra_info(self, _name):
        return self._peer

    def abort(self):
        self.open = False


def test_a_connection_on_which_no_whole_request_comes_is_ended():
    door, half, whole = Doorkeeper(), Connection("10.0.0.1"), Connection("10.0.0.1")
    door.sweep([half, whole], 100.0)
    door.served(whole)
    door.sweep([half, whole], 100.0 + 0.9 * DEADLINE_S)
    assert half.open
    door.sweep([half, whole], 100.0 + DEADLINE_S)
    assert (half.open, whole.open) == (False, True)


@pytest.mark.parametrize(
    "hosts", [["10.0.0.1"], ["::ffff:10.0.0.1"], ["2001:db8::1", "2001:db8::2"]]
)
def test_an_address_has_so_many_connections_and_no_more(hosts):
    door, page, other = Doorkeeper(), Connection(hosts[-1]), Connection("10.9.9.9")
    many = [Connection(hosts[i % len(hosts)]) for i in range(1000)]
    door.sweep(many[:500], 100.0)
    door.served(page)
    door.served(other)
    door.sweep([*many, page, other], 101.0)
    assert (page.open, other.open) == (True, True)
    assert sum(each.open for each in many) == MOST - 1


def test_a_thousand_half_sent_requests_do_not_stay():
    """Of a real server; what is left after one look is ended by a later one."""

    async def run():
        listen = Listen("127.0.0.1", 0)
        access = Access("pa10")
        server = Server(load_cell("pa10"), PageHub(nobody), access, listen, secure=False)
        runner = web.AppRunner(server.application(), access_log=None)
        await runner.setup()
        await web.TCPSite(runner, "127.0.0.1", 0).start()
        port = runner.addresses[0][1]
        many = [await asyncio.open_connection("127.0.0.1", port) for _ in range(200)]
        for _, writer in many:
            writer.write(b"GET / HTTP/1.1\r\nHost: ")
            await writer.drain()
        while len(runner.server.connections) < len(many):
            await asyncio.sleep(0)
        for now_s, left in ((100.0, MOST), (100.0 + DEADLINE_S, 0)):
            server.door.sweep([each.transport for each in runner.server.connections], now_s)
            while len(runner.server.connections) > left:
                await asyncio.sleep(0)
        for reader, writer in many:
            with suppress(ConnectionError):
                assert await reader.read() == b""
            writer.close()
        await runner.cleanup()

    asyncio.run(run())
