import json

import zenoh

from bus import BusSettings
from bus.session.config import IMAGE_BATCHES, SOCKET_BYTES, session_config
from bus.session.link_use import MAX_LINKS


def test_zenoh_understands_it() -> None:
    settings = BusSettings(mode="peer", listen=["tcp/127.0.0.1:0"], lease_s=1.5, shared_memory=False)
    config = zenoh.Config.from_json5(json.dumps(session_config(settings)))
    assert json.loads(config.get_json("transport/link/tx/lease")) == 1500
    assert json.loads(config.get_json("transport/link/tx/queue/size/interactive_low")) == 16
    assert json.loads(config.get_json("transport/shared_memory/enabled")) is False
    assert json.loads(config.get_json("transport/link/tcp")) == {"so_sndbuf": SOCKET_BYTES, "so_rcvbuf": SOCKET_BYTES}
    assert json.loads(config.get_json("transport/link/tx/queue/size"))["data_low"] == IMAGE_BATCHES
    assert json.loads(config.get_json("scouting/multicast/enabled")) is False
    assert json.loads(config.get_json("listen/endpoints")) == ["tcp/127.0.0.1:0"]
    assert json.loads(config.get_json("connect/endpoints")) == ["tcp/127.0.0.1:7447"]


def test_a_peer_listens_only_where_it_is_told() -> None:
    assert session_config(BusSettings(mode="peer"))["listen"]["endpoints"] == []


def test_more_links_than_zenohs_default_may_come_at_once() -> None:
    config = zenoh.Config.from_json5(json.dumps(session_config(BusSettings())))
    unicast = json.loads(config.get_json("transport/unicast"))
    assert (unicast["max_sessions"], unicast["accept_pending"]) == (MAX_LINKS, MAX_LINKS)
    assert session_config(BusSettings(), 700)["transport"]["unicast"]["max_sessions"] == 700


def test_signs_of_life_are_at_most_half_a_second_apart() -> None:
    def keep_alive(lease_s: float) -> object:
        return session_config(BusSettings(lease_s=lease_s))["transport"]["link"]["tx"]["keep_alive"]

    assert [keep_alive(0.5), keep_alive(2), keep_alive(2.1), keep_alive(60)] == [4, 4, 5, 120]


def test_who_has_another_router_to_go_to_waits_less_for_one_that_is_gone() -> None:
    def open_timeout(*connect: str) -> int:
        settings = BusSettings(mode="client", connect=list(connect), listen=["tcp/127.0.0.1:0"])
        return int(session_config(settings)["transport"]["unicast"]["open_timeout"])

    assert open_timeout("tcp/one:7447", "tcp/other:7447") < open_timeout("tcp/one:7447")
