import pytest

from services.monitor.web.auth.gate import RequestInfo, ServedAt, Verdict, body_limit, judge, local_path
from services.monitor.web.auth.users import Kind, Role, Visitor

OURS = {"host": "monitor:1", "origin": "http://monitor:1"}
VIEWER = Visitor("v", lambda: Role.VIEWER)
GONE = Visitor("g", lambda: None)


def verdict(
    method: str,
    path: str,
    visitor: Visitor | None,
    headers: dict[str, str],
    *,
    own: str = "",
    open_metrics: bool = False,
) -> Verdict:
    asking = RequestInfo(method, path, headers)
    return judge(asking, visitor, by=Kind.SESSION, place=ServedAt(own, open_metrics=open_metrics))


def test_a_socket_is_opened_from_our_own_page_alone() -> None:
    assert verdict("", "/_nicegui_ws/socket.io/", VIEWER, OURS) is Verdict.PASS
    assert verdict("", "/_nicegui_ws/socket.io/", VIEWER, {**OURS, "origin": "http://evil"}) is Verdict.FOREIGN
    assert verdict("", "/api/v1/live", VIEWER, {"host": "monitor:1"}) is Verdict.FOREIGN
    assert verdict("", "/api/v1/live", None, OURS) is Verdict.UNKNOWN
    assert verdict("", "/api/v1/live", GONE, OURS) is Verdict.UNKNOWN
    for method, path in (("", "/api/v1/live"), ("POST", "/api/v1/alerts/a1/resolve")):
        for nobody in (None, GONE):
            assert verdict(method, path, nobody, {"host": "monitor:1"}) is Verdict.UNKNOWN, "its token may be missing"
    assert verdict("POST", "/login", None, {"host": "monitor:1"}) is Verdict.FOREIGN
    token = RequestInfo("", "/api/v1/live", {"host": "monitor:1"})
    assert judge(token, VIEWER, by=Kind.TOKEN, place=ServedAt()) is Verdict.PASS


def test_behind_a_proxy_its_origin_is_ours_and_no_other() -> None:
    behind = {"host": "monitor:1", "origin": "https://fleet.example"}
    assert verdict("POST", "/logout", VIEWER, behind, own="https://fleet.example") is Verdict.PASS
    assert verdict("POST", "/logout", VIEWER, OURS, own="https://fleet.example") is Verdict.FOREIGN


def test_an_origin_without_a_host_is_not_ours() -> None:
    assert verdict("POST", "/login", None, {"origin": "null"}) is Verdict.FOREIGN
    assert verdict("POST", "/login", None, {"host": "", "origin": "http://"}) is Verdict.FOREIGN
    assert verdict("POST", "/login", None, {"host": "monitor:1", "origin": "http://["}) is Verdict.FOREIGN


def test_another_origin_does_not_even_read() -> None:
    assert verdict("GET", "/_nicegui_ws/socket.io/", VIEWER, {**OURS, "origin": "http://monitor:2"}) is Verdict.FOREIGN
    assert verdict("GET", "/_nicegui_ws/socket.io/", VIEWER, OURS) is Verdict.PASS


def test_on_loopback_somebody_elses_name_for_it_is_not_ours() -> None:
    place = ServedAt(hosts=frozenset({"localhost", "127.0.0.1", "[::1]"}))
    for host in ("localhost", "LOCALHOST:8080", "127.0.0.1:8080", "[::1]", "[::1]:8080"):
        asking = RequestInfo("GET", "/login", {"host": host})
        assert judge(asking, None, by=None, place=place) is Verdict.PASS, host
    for host in ("evil.test:8080", "", "localhost.evil.test", "[::1].evil.test", "127.0.0.1.evil.test:80", ":80"):
        asking = RequestInfo("POST", "/login", {"host": host, "origin": f"http://{host}"})
        assert judge(asking, None, by=None, place=place) is Verdict.MISDIRECTED, host


def test_metrics_are_open_only_where_the_settings_say_so() -> None:
    assert verdict("GET", "/metrics", None, {}) is Verdict.UNKNOWN
    assert verdict("GET", "/metrics", None, {}, open_metrics=True) is Verdict.PASS
    assert verdict("GET", "/metrics/x", None, {}, open_metrics=True) is Verdict.UNKNOWN


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "TRACE", "CONNECT", "ODD", "get"])
def test_a_viewer_changes_nothing_by_whatever_method(method: str) -> None:
    assert verdict(method, "/api/v1/anything/new", VIEWER, OURS) is Verdict.NOT_ALLOWED


@pytest.mark.parametrize(
    "elsewhere",
    [
        "http://evil",
        "//evil",
        "/\\evil",
        "\\\\evil",
        "/a\nb",
        "/\tevil",
        "javascript:x",
        "",
        "x",
        "/" + "x" * 1_000,
        "/ä",
    ],
)
def test_log_in_leads_nowhere_else(elsewhere: str) -> None:
    assert local_path(elsewhere) == "/"


def test_log_in_leads_where_one_wanted_to_go() -> None:
    assert local_path("/alerts/x%20y?z=1") == "/alerts/x%20y?z=1"


def test_only_the_pages_own_script_may_send_much() -> None:
    assert (body_limit("/login"), body_limit("/_nicegui_ws/socket.io/")) == (64 * 1024, 1024 * 1024)
