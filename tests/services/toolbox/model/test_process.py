"""The command against a registry of the test's own; with real workers in tests/integration/services."""

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from bus import Bus, BusSettings, QoS, Reply, Request, open_bus
from schemas import codec, keys
from schemas.models import ModelRegistry, ModelUse
from schemas.status import WorkerStatus
from schemas.worker_keys import ModelKey, worker_status
from services.detector.settings import SHIPPED_MODEL
from services.model_registry.client import ask_registry, publish_model, use_model
from services.model_registry.registry import digest_of
from services.model_registry.serving import serving_models
from services.toolbox.demo.children import free_ports
from services.toolbox.model import listing, process
from services.toolbox.model.process import _ModelCommandError, chosen, run
from services.toolbox.model.settings import ModelSettings
from tests.services.model_registry.publishing import model_of
from tests.waiting import PATIENCE_S

ONE, TWO = (model_of(content, content.decode()) for content in (b"one", b"two"))


class Site:
    """A monitor's bus with a registry, and the command against it."""

    def __init__(self, bus: Bus, endpoint: str, folder: Path) -> None:
        self.bus = bus
        self.folder = folder
        self._endpoint = endpoint

    async def run(self, *arguments: str, **options: object) -> int:
        fields = dict(zip(("task", "target"), arguments, strict=False))
        return await run(ModelSettings.model_validate({"connect": [self._endpoint], **fields, **options}))

    async def publish(self, *contents: bytes) -> None:
        for content in contents:
            file = self.folder / "file"
            file.write_bytes(content)
            await publish_model(self.bus, model_of(content, content.decode()), file, lambda _: None)

    async def state(self) -> ModelRegistry:
        return await ask_registry(self.bus, PATIENCE_S)


@asynccontextmanager
async def site_in(folder: Path) -> AsyncIterator[Site]:
    endpoint = f"tcp/127.0.0.1:{free_ports(1)}"
    async with open_bus(BusSettings(mode="router", listen=[endpoint])) as bus:
        yield Site(bus, endpoint, folder)


@pytest.fixture
async def site(tmp_path: Path) -> AsyncIterator[Site]:
    async with site_in(tmp_path) as made, serving_models(made.bus, tmp_path / "registry"):
        yield made


async def test_publish_says_what_the_model_detects_and_how_to_use_it(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    assert await site.run("publish", str(SHIPPED_MODEL), name="site-2") == 0
    (model,) = (await site.state()).models
    assert (model.name, model.digest) == ("site-2", digest_of(SHIPPED_MODEL))
    assert model.about == "segmentation of box, pallet, forklift"
    assert "@" in model.by
    assert capsys.readouterr().out.splitlines() == [
        f"published: {model.label}, segmentation of box, pallet, forklift",
        "put it in force with: fleetsight model use site-2",
    ]
    assert await site.run("publish", str(SHIPPED_MODEL), name="again") == 0
    assert capsys.readouterr().out == f"published already: {model.label}, by {model.by}\n"


@pytest.mark.parametrize(("name", "content"), [("bad.pt", b"no weights"), ("bad.onnx", b"no model")])
async def test_a_file_that_is_no_model_is_not_published(
    name: str, content: bytes, site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_bytes(content)
    assert await site.run("publish", str(tmp_path / name)) == 1
    assert f"fleetsight model: publish {tmp_path}/{name}: not a model that can be used" in capsys.readouterr().err
    assert (await site.state()).models == []


async def test_a_name_that_is_taken_is_an_error(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    await site.publish(b"one")
    assert await site.run("publish", str(SHIPPED_MODEL), name="one") == 1
    assert capsys.readouterr().err == (
        f"fleetsight model: one is the name of {ONE.label}: give this one another (--name)\n"
    )


async def test_use_back_and_a_canary(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    await site.publish(b"one", b"two")
    assert await site.run("use", "one") == 0
    assert await site.run("use", TWO.digest[:6], robots=["r2", "r1"]) == 0
    state = await site.state()
    assert (state.in_force, state.canary, state.robots) == (ONE.digest, TWO.digest, ["r1", "r2"])
    assert capsys.readouterr().out.splitlines()[-3:-1] == [
        f"in force: {ONE.label}",
        f"canary for r1, r2: {TWO.label}",
    ]
    assert await site.run("back") == 0
    assert (await site.state()).canary == ""
    assert await site.run("back") == 1
    assert "fleetsight model: there is no model to go back to: none was in force before" in capsys.readouterr().err


async def test_a_canary_for_robots_that_are_not_online_names_them(
    site: Site, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(listing, "LISTEN_S", 0.5)
    await site.publish(b"one", b"two")
    await use_model(site.bus, ModelUse(digest=ONE.digest), PATIENCE_S)
    async with site.bus.announce(keys.robot_alive("r1")), site.bus.announce(keys.robot_alive("r2")):
        monkeypatch.setattr(listing, "LISTEN_S", PATIENCE_S)
        assert await site.run("use", "two", robots=["r1", "r2"]) == 0
        assert capsys.readouterr().err == ""
        monkeypatch.setattr(listing, "LISTEN_S", 1.0)
        assert await site.run("use", "two", robots=["r1", "r7", "R2"]) == 0
        assert capsys.readouterr().err == "fleetsight model: not online now, so check the names: R2, r7\n"
    assert (await site.state()).robots == ["R2", "r1", "r7"]


async def test_back_names_what_it_leaves_and_does_nothing_where_that_was_left_meanwhile(
    site: Site, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    await site.publish(b"one", b"two")
    for model in ONE, TWO:
        await use_model(site.bus, ModelUse(digest=model.digest), PATIENCE_S)

    async def asked_before(bus: Bus, timeout_s: float) -> ModelRegistry:
        state = await ask_registry(bus, timeout_s)
        await use_model(site.bus, ModelUse(digest=""), PATIENCE_S)  # somebody else is quicker
        return state

    monkeypatch.setattr(process, "ask_registry", asked_before)
    assert await site.run("back") == 1
    assert f"{TWO.label} was left meanwhile: now going back would leave {ONE.label}" in capsys.readouterr().err
    assert (await site.state()).in_force == ONE.digest


async def test_without_an_answer_it_may_have_been_done(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    async def listed(_: Request) -> Reply:
        return Reply(codec.encode(ModelRegistry(models=[ONE], in_force=ONE.digest)), codec.encoding(ModelRegistry))

    async def silent(_: Request) -> Reply:
        await asyncio.sleep(PATIENCE_S)
        raise AssertionError

    async with (
        site_in(tmp_path) as site,
        site.bus.serve(ModelKey.LIST, listed),
        site.bus.serve(ModelKey.USE, silent),
    ):
        for arguments in ("back",), ("use", "one"):
            assert await site.run(*arguments, timeout_s=1) == 1
            assert "; it may have been done: fleetsight model list\n" in capsys.readouterr().err


async def test_list_shows_models_and_the_workers_that_run_them(
    site: Site, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(listing, "LISTEN_S", 0.5)
    await site.publish(b"one", b"two")
    await use_model(site.bus, ModelUse(digest=ONE.digest), PATIENCE_S)
    await use_model(site.bus, ModelUse(digest=TWO.digest, robots=["r1"]), PATIENCE_S)
    status = WorkerStatus(
        service="detector",
        worker="w1",
        model=ONE.label,
        canary=TWO.label,
        sent_ns=1,
        runtime="onnx",
        remarks=["a remark\x1b"],
    )
    key, encoding = worker_status("detector", "w1"), codec.encoding(WorkerStatus)
    async with site.bus.publisher(key, QoS.STATUS, encoding=encoding) as worker:
        worker.put(codec.encode(status))
        assert await site.run("list") == 0
        table = capsys.readouterr().out
        assert await site.run("list", json=True) == 0
        listed = json.loads(capsys.readouterr().out)
    newest, oldest = table.splitlines()[1:3]
    assert newest.split()[:3] == ["two", TWO.digest[:12], "0.0"]
    assert newest.endswith("canary for r1")
    assert oldest.endswith("in force")
    assert f"w1      {ONE.label}  onnx   canary {TWO.label}" in table
    assert "  w1: a remark\\x1b\n" in table
    assert listed["workers"] == [
        {"worker": "w1", "model": ONE.label, "runtime": "onnx", "canary": TWO.label, "remarks": ["a remark\x1b"]}
    ]
    assert [each["digest"] for each in listed["models"]] == [ONE.digest, TWO.digest]


async def test_an_empty_registry_says_how_to_begin(
    site: Site, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(listing, "LISTEN_S", 0.1)
    assert await site.run("list") == 0
    assert capsys.readouterr().out == (
        "no model is published yet: fleetsight model publish FILE\n\nno detector worker is heard\n"
    )


@pytest.mark.parametrize("arguments", [("list",), ("back",), ("use", "one"), ("publish", str(SHIPPED_MODEL))])
async def test_without_a_registry_they_say_how_to_switch_it_on(
    tmp_path: Path, arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    async with site_in(tmp_path) as site:
        assert await site.run(*arguments) == 1
    assert "no model registry answers: start the fleet's monitor with --models FOLDER" in capsys.readouterr().err


async def test_without_a_router_they_say_so(capsys: pytest.CaptureFixture[str]) -> None:
    nowhere = f"tcp/127.0.0.1:{free_ports(1)}"
    settings = ModelSettings.model_validate({"task": "list", "connect": [nowhere]})
    assert await run(settings) == 1
    assert capsys.readouterr().err == f"fleetsight model: there is no router at {nowhere} yet\n"


def named(name: str, digest: str) -> ModelRegistry:
    model = model_of(name.encode(), name)
    return ModelRegistry(models=[type(model)(digest=digest, name=name, size=1)])


def test_a_model_is_chosen_by_name_label_or_the_beginning_of_its_digest() -> None:
    state = ModelRegistry(models=[ONE, TWO])
    for target in ("one", ONE.label, f"{ONE.label}.pt", ONE.digest, ONE.digest[:4], ONE.digest[:9].upper()):
        assert chosen(state, target) == ONE
    for target in ("on", ONE.digest[:3], "0" * 64):
        with pytest.raises(_ModelCommandError, match=f"no published model is called '{target}'; there are: one, two"):
            chosen(state, target)
    with pytest.raises(_ModelCommandError, match="there are: none is published yet"):
        chosen(ModelRegistry(models=[]), "one")


def test_a_name_that_is_how_another_s_digest_begins_is_ambiguous() -> None:
    one, two = named("abcd", "0" * 64).models[0], named("two", "abcd" + "1" * 60).models[0]
    state = ModelRegistry(models=[one, two])
    with pytest.raises(_ModelCommandError, match="abcd is ambiguous: abcd@000000000000, two@abcd11111111; write one"):
        chosen(state, "abcd")
    assert chosen(state, "abcd@000000000000") == one
    assert chosen(state, "two@abcd11111111") == two
    assert chosen(state, "two@abcd1") == two
    assert chosen(state, "abcd1") == two


def test_an_ambiguous_digest_shows_what_tells_the_models_apart() -> None:
    digests = ["abcd" + "0" * 60, "abcd" + "1" * 60]
    state = ModelRegistry(models=[model for n, digest in enumerate(digests) for model in named(f"m{n}", digest).models])
    with pytest.raises(
        _ModelCommandError, match="abcd is ambiguous: m0@abcd00000000, m1@abcd11111111; write one of these, or more"
    ):
        chosen(state, "abcd")
    assert chosen(state, "abcd1").name == "m1"


async def test_an_exported_model_is_made_and_published_as_what_it_is(
    site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "best.onnx"
    assert await site.run("export", str(SHIPPED_MODEL), output=file, image_size=320) == 0
    assert capsys.readouterr().out.startswith(f"exported: {file}, 6.")
    assert await site.run("publish", str(file)) == 0
    (model,) = (await site.state()).models
    assert (model.name, model.form, model.about) == ("best", "onnx", "segmentation of box, pallet, forklift")
    kept = tmp_path / "registry" / f"{model.digest}.onnx"
    assert await asyncio.to_thread(kept.read_bytes) == await asyncio.to_thread(file.read_bytes)
    capsys.readouterr()
    assert await site.run("export", str(file), output=tmp_path / "again.onnx") == 1
    assert capsys.readouterr().err == f"fleetsight model: {file} is exported already\n"
