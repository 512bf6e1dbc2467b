import asyncio
import time
from datetime import datetime
from pathlib import Path

import msgspec

from bus.fake import FakeNetwork
from schemas.alerts import Alert, AlertState, Severity
from schemas.status import WorkerStatus
from services.monitor.formats import epoch_ns
from services.monitor.history.state import Act
from services.monitor.monitor import Monitor
from services.monitor.rules.loading import load_rules
from services.monitor.rules.model import RuleBook
from services.monitor.web.pages.health import facts
from tests.services.monitor.alerting.test_webhooks import receiving
from tests.services.monitor.web.api.seeing import FRONT, ODD, fill
from tests.services.monitor.web.asking import Web, web_in
from tests.services.monitor.web.serving import monitor_on
from tests.waiting import until

RULES = """rules: [{name: here, when: over, class: box, count: 0}, {name: gone, when: silent}]
webhooks: {ops: {url: "https://user:pw@ops.example/x", secret: do-not-tell}}"""


def alert(name: str = "a1", state: AlertState = AlertState.RAISED) -> Alert:
    return Alert(
        id=name, rule="here", severity=Severity.WARNING, state=state, robot="r1", camera=name, name="box", text=ODD,
        raised_ns=10**18, changed_ns=time.time_ns(),
    )  # fmt: skip


def raise_alert(monitor: Monitor, *alerts: Alert) -> None:
    monitor.rules.book = load_rules(RULES)
    monitor.alerting._engine = None
    monitor.alerting.lead(alerts)


async def test_operators_act_and_who_did_what_is_told(web: Web) -> None:
    raise_alert(web.monitor, alert(), alert("a2"))
    async with await web.browser() as browser:
        acknowledged = await browser.post("/api/v1/alerts/a1/acknowledge")
        assert acknowledged.json()["state"] == "acknowledged"
        await browser.post("/api/v1/alerts/a1/escalate")
        (first, second) = (await browser.get("/api/v1/alerts")).json()["items"]
        assert [(act["state"], act["who"]) for act in first["acts"]] == [
            ("acknowledged", "operator"),
            ("escalated", "operator"),
        ]
        assert (first["text"], first["class"], second["acts"]) == (ODD, "box", [])
        assert (await browser.post("/api/v1/alerts/a1/resolve")).json()["state"] == "resolved"
        gone = await browser.post("/api/v1/alerts/a1/resolve")
        assert (gone.status_code, gone.json()) == (404, {"error": "no open alert 'a1'"})
        assert [each["id"] for each in (await browser.get("/api/v1/alerts?robot=r1")).json()["items"]] == ["a2"]
        assert (await browser.get("/api/v1/alerts?robot=r2")).json()["items"] == []


async def test_what_somebody_did_already_is_answered_and_not_noted_again(web: Web) -> None:
    raise_alert(web.monitor, alert())
    async with await web.browser() as browser:

        async def done(what: str) -> list[tuple[str, str]]:
            answer = (await browser.post(f"/api/v1/alerts/a1/{what}")).json()
            return [(act["state"], act["who"]) for act in answer["acts"]]

        mine = ("acknowledged", "operator")
        assert await done("acknowledge") == [mine]
        assert await done("acknowledge") == [mine]
        web.monitor.acknowledge("a1", "bob")
        assert await done("acknowledge") == [mine, ("acknowledged", "bob")]
        assert (await done("escalate"))[2:] == [("escalated", "operator")]
        assert (await done("escalate"))[2:] == [("escalated", "operator")]
        assert (await done("acknowledge"))[3:] == [mine], "it had escalated meanwhile"
        await done("resolve")
        assert (await browser.post("/api/v1/alerts/a1/resolve")).status_code == 404
        assert [act.state for act in web.monitor.acts_of("a1")].count(AlertState.RESOLVED) == 1


async def test_until_when_it_was_known_is_told_of_an_alert_whose_camera_is_silent(web: Web) -> None:
    fill(web.monitor.fleet)
    about = msgspec.structs.replace(alert(), camera="front")
    raise_alert(web.monitor, about, msgspec.structs.replace(about, id="a2", rule="gone", camera="", name=""))
    async with await web.program() as program:

        async def until() -> list[str | None]:
            return [each["known_until"] for each in (await program.get("/api/v1/alerts")).json()["items"]]

        assert await until() == [None, None]
        web.monitor.fleet.robot_presence("r1", alive=False)
        view = web.monitor.fleet.inventory.camera(FRONT)
        assert view is not None
        (seen, silence) = await until()
        assert (seen is not None and epoch_ns(datetime.fromisoformat(seen)) // 1_000, silence) == (
            view.last_ns // 1_000,
            None,
        )
    async with await web.browser() as browser:
        assert (await browser.post("/api/v1/alerts/a1/acknowledge")).json()["known_until"] == seen
        assert (await browser.post("/api/v1/alerts/a1/resolve")).json()["known_until"] is None


async def test_rules_are_told_without_their_secrets(web: Web) -> None:
    web.monitor.rules.book = load_rules(RULES)
    web.monitor.rules.problem = "rules.yaml: line 3: 'clas' is not a known key here; the rules stay as they were"
    async with await web.program() as program:
        answer = await program.get("/api/v1/rules")
        assert (answer.json()["problem"], answer.json()["webhooks"]) == (web.monitor.rules.problem, ["ops"])
        assert answer.json()["rules"][0]["class"] == "box"
        assert not [secret for secret in ("do-not-tell", "pw", "ops.example") if secret in answer.text]
        assert web.monitor.rules.problem in (await program.get("/api/v1/status")).json()["problems"]


async def test_what_rules_name_that_there_is_none_of_is_remarked(web: Web) -> None:
    rules = "rules: [{name: near, when: nearer, class: forklfit, than_m: 2, robots: [dokc1]}]"
    web.monitor.rules.book = load_rules(rules)
    now_ns = time.time_ns()
    worker = WorkerStatus(service="detector", worker="w1", model="m", sent_ns=now_ns, classes=["forklift"])
    web.monitor.fleet.worker_status(worker, now_ns)
    web.monitor.fleet.robot_presence("dock1", alive=True)
    remarks = ["rule 'near': no detector reports 'forklfit'", "rule 'near': no robot is called 'dokc1'"]
    async with await web.program() as program:
        assert (await program.get("/api/v1/rules")).json()["remarks"] == remarks
    assert dict(facts(web.monitor, now_ns))["Rules"] == "; ".join(["1 in force", *remarks])


async def test_a_webhook_that_takes_no_alerts_is_among_the_monitors_problems(web: Web) -> None:
    async with receiving(400, 200) as (_, webhook), await web.program() as program:

        async def problems() -> list[str]:
            found: list[str] = (await program.get("/api/v1/status")).json()["problems"]
            return found

        web.monitor.rules.book = RuleBook(webhooks={"ops": webhook})
        webhooks = web.monitor.alerting._delivery.webhooks
        running = asyncio.create_task(webhooks.run())
        webhooks.post("ops", webhook, alert())
        await until(lambda: webhooks.counts)
        assert await problems() == ["webhook ops takes no alerts: status 400"]
        webhooks.post("ops", webhook, alert())
        await until(lambda: len(webhooks.counts) == 2)
        assert await problems() == []
        running.cancel()
        await asyncio.wait([running])


async def test_another_monitors_alerts_are_told_and_left_to_it(tmp_path: Path) -> None:
    history = f"sqlite:///{tmp_path / 'history.db'}"
    async with FakeNetwork().open_bus() as bus, web_in(tmp_path, history=history) as web:
        leading = monitor_on(bus, history=history).history
        await leading.restore()
        leading.alert(alert())
        leading.act(Act("a1", AlertState.RAISED, "ann", 10**18))
        await leading._attempt()
        await web.monitor.history._attempt()
        async with await web.program() as program:
            (item,) = (await program.get("/api/v1/alerts")).json()["items"]
            assert (item["id"], [act["who"] for act in item["acts"]]) == ("a1", ["ann"])
            assert (await program.get("/api/v1/status")).json()["alerts"] == 1
            left = await program.post("/api/v1/alerts/a1/resolve")
            assert (left.status_code, left.json()) == (
                409,
                {"error": "another monitor raises the alerts: ask that one"},
            )
        await web.monitor.history._end()
        await leading._end()


async def test_an_alert_about_an_object_says_which_and_where_its_page_is(tmp_path: Path) -> None:
    rules = tmp_path / "rules.yaml"
    rules.write_text("rules: [{name: in, when: enters, class: box, site: hall, zone: dock}]", encoding="utf-8")
    about = msgspec.structs.replace(alert(), rule="in", robot="", camera="", site="hall", object="o1")
    async with web_in(tmp_path, rules=rules, web_url="https://fleet.example") as web:
        await web.monitor.rules.load()
        web.monitor.alerting._engine, web.monitor.alerting._page = None, "https://fleet.example"
        web.monitor.alerting.lead([about])
        async with await web.program() as program:
            (told,) = (await program.get("https://fleet.example/api/v1/alerts")).json()["items"]
        assert (told["site"], told["object"], told["link"]) == ("hall", "o1", "/world/hall/o1")
        (posted,) = web.monitor.alerts()
        assert posted.link == "https://fleet.example/world/hall/o1"
