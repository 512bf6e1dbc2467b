"""The monitor's page and API as they are run: a real process, a real browser's steps, a signal at the end."""

import asyncio
import re
import sys
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import httpx
import websockets

from bus import QoS
from schemas import codec, keys
from schemas.detections import ClassList
from schemas.inventory import InventoryAnswer
from schemas.keys import Stream
from services.toolbox.demo.children import Child
from services.toolbox.process import EXIT_USAGE
from tests.integration.fleet import PATIENCE_S, fleet_rig
from tests.services.monitor.inventory.seeing import FRONT, seen

PASSWORD = "correct horse battery"  # noqa: S105 - nobody's


async def said(child: Child, pattern: str) -> str:
    async with asyncio.timeout(PATIENCE_S):
        while not (found := re.search(pattern, "\n".join(child.output))):  # noqa: ASYNC110 - nobody tells
            await asyncio.sleep(0.05)
    return found[1]


async def test_from_the_first_user_to_the_end(tmp_path: Path) -> None:
    history = f"sqlite:///{tmp_path / 'history.db'}"
    async with fleet_rig() as rig:
        child = await rig.start("monitor", "--mode", "client", "--web-port", "0", "--history", history)
        url = await said(child, r"page: (\S+)")
        link = await said(child, r"first user: (\S+)")
        assert link.startswith(f"{url}/setup?token=")
        answer = (await rig.bus.request(keys.INVENTORY, timeout_s=PATIENCE_S)).payload
        assert codec.decode(InventoryAnswer, answer, codec.encoding(InventoryAnswer)).problems == []
        assert b"setup" not in bytes(answer), "whoever can ask on the bus would become the first user"
        async with httpx.AsyncClient(base_url=url, headers={"Origin": url}, timeout=PATIENCE_S) as browser:
            given = {"token": parse_qs(urlsplit(link).query)["token"][0], "name": "ann", "password": PASSWORD}
            assert (await browser.post("/setup", data={**given, "again": PASSWORD})).status_code == 303
            assert (await browser.get("/healthz")).json()["status"] == "ok"
            async with rig.bus.publisher(
                FRONT.stream(Stream.CLASSES), QoS.RESULT, encoding=codec.encoding(ClassList)
            ) as out:
                for seq in (1, 2, 3):
                    out.put(codec.encode(seen(seq, {"box": 2})))
                async with asyncio.timeout(PATIENCE_S):
                    while not (items := (await browser.get("/api/v1/inventory")).json()["items"]):  # noqa: ASYNC110 - nobody tells
                        await asyncio.sleep(0.1)
            assert [(each["class"], each["count"]) for each in items] == [("box", 2)]
            cookie = "; ".join(f"{name}={value}" for name, value in browser.cookies.items())
            headers = {"Cookie": cookie, "Origin": url}
            async with websockets.connect(f"ws{url[4:]}/api/v1/live", additional_headers=headers) as live:
                assert '"box"' in str(await live.recv())
                child.process.terminate()
                async with asyncio.timeout(PATIENCE_S):
                    assert await child.process.wait() == 0
                    await live.wait_closed()
        assert "exiting at once" not in child.last_words


async def test_a_floor_plan_that_is_not_there_is_one_line_and_the_exit_code_of_a_wrong_setting(
    tmp_path: Path,
) -> None:
    options = ["monitor", "--listen", "tcp/127.0.0.1:0", "--history", "none", "--web-port", "0"]
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "services.toolbox", *options, "--floor-plan", str(tmp_path / "absent.yaml")),
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
    )
    async with asyncio.timeout(PATIENCE_S):
        _, errors = await process.communicate()
    assert process.returncode == EXIT_USAGE
    assert f"fleetsight monitor: floor plan {tmp_path}/absent.yaml: No such file or directory\n" in errors.decode()


async def test_a_port_that_is_taken_is_one_line_and_the_exit_code_of_a_wrong_setting(tmp_path: Path) -> None:
    async with await asyncio.start_server(lambda _, writer: writer.close(), "127.0.0.1", 0) as taken:
        port = str(taken.sockets[0].getsockname()[1])
        options = ["monitor", "--web-port", port, "--history", f"sqlite:///{tmp_path / 'history.db'}"]
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "services.toolbox", *options), stderr=asyncio.subprocess.PIPE
        )
        async with asyncio.timeout(PATIENCE_S):
            _, errors = await process.communicate()
    assert process.returncode == EXIT_USAGE
    assert re.fullmatch(
        rf"fleetsight monitor: --web-host 127.0.0.1 --web-port {port}: Address already in use.*\n", errors.decode()
    )
