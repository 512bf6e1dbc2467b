from __future__ import annotations

from weakref import ref
from xmlrpc.client import dumps

import pytest

from gateway.ros1.errors import HttpError, XmlRpcError
from gateway.ros1.wire.http import MAX_HEAD_BYTES, ClientExchange, ServerExchange
from gateway.ros1.wire.xmlrpc import MethodCall, MethodResponse, encode
from tests.gateway.ros1.golden.messages import PYTHON2_STATE, PYTHON2_SUBSCRIBED, PYTHON2_UNSET, PYTHON2_UPDATE, TOPIC

CALL = MethodCall("getPid", ("/ours",))
BODY = encode(CALL)
ANSWER = MethodResponse([1, "", 7])
MAX_BODY_BYTES = 4000


def client(host: str = "robot:1", target: str = "/") -> ClientExchange:
    return ClientExchange(host=host, target=target, call=CALL, max_body_bytes=MAX_BODY_BYTES)


def server() -> ServerExchange:
    return ServerExchange(MAX_BODY_BYTES)


def test_both_sides_understand_each_other() -> None:
    ours, theirs = client(), server()
    assert theirs.receive_data(ours.opening) == CALL
    assert ours.receive_data(theirs.answer(encode(ANSWER))) == ANSWER


def test_however_it_is_split() -> None:
    ours, theirs = client(), server()
    opening = ours.opening
    calls = [theirs.receive_data(opening[i : i + 1]) for i in range(len(opening))]
    answer = theirs.answer(encode(ANSWER))
    answers = [ours.receive_data(answer[i : i + 1]) for i in range(len(answer))]
    assert calls == [None] * (len(opening) - 1) + [CALL]
    assert answers == [None] * (len(answer) - 1) + [ANSWER]


FIRST, SECOND = "http://127.0.0.1:45454/", "http://127.0.0.1:45456/"


@pytest.mark.parametrize(
    ("answer", "value"),
    [
        (PYTHON2_SUBSCRIBED, [1, f"Subscribed to [{TOPIC}]", [FIRST]]),
        (
            PYTHON2_STATE,
            [1, "current system state", [[[TOPIC, ["/camera", "/camera2"]]], [[TOPIC, ["/gateway"]]], []]],
        ),
        (PYTHON2_UNSET, [-1, "Parameter [/use_sim_time] is not set", 0]),
    ],
)
def test_a_master_under_python_2_is_understood(answer: bytes, value: list[object]) -> None:
    assert client().receive_data(answer) == MethodResponse(value)


def test_a_master_under_python_2_tells_of_publishers() -> None:
    assert server().receive_data(PYTHON2_UPDATE) == MethodCall("publisherUpdate", ("/master", TOPIC, [FIRST, SECOND]))


# As xmlrpc.client of Python 3, xmlrpcpp and HTTP/1.0 clients send it.
HEADS = [
    """POST /RPC2 HTTP/1.1
Host: robot:1
Accept-Encoding: gzip
Content-Type: text/xml
User-Agent: Python-xmlrpc/3.11
Content-Length: %d

""",
    """POST / HTTP/1.1
User-Agent: XMLRPC++ 0.7
Host: robot:1
Content-Type: text/xml
Content-length: %d

""",
    """POST / HTTP/1.0
Content-Length: %d
Connection: keep-alive

""",
]


@pytest.mark.parametrize("head", HEADS, ids=["xmlrpc.client", "xmlrpcpp", "HTTP/1.0"])
def test_what_ros_nodes_send(head: str) -> None:
    exchange = server()
    assert exchange.receive_data((head % len(BODY)).replace("\n", "\r\n").encode() + BODY) == CALL
    answer = exchange.answer(b"<x/>")
    assert answer.startswith(b"HTTP/1.1 200 ")
    assert answer.endswith(b"\r\nContent-Type: text/xml\r\nContent-Length: 4\r\nConnection: close\r\n\r\n<x/>")


def chunked(*pieces: bytes) -> bytes:
    chunks = b"".join(b"%x\r\n%s\r\n" % (len(piece), piece) for piece in pieces)
    return b"Transfer-Encoding: chunked\r\n\r\n" + chunks


def test_answer_in_chunks() -> None:
    answer = encode(ANSWER)
    assert client().receive_data(b"HTTP/1.1 200 OK\r\n" + chunked(answer[:10], answer[10:], b"")) == ANSWER


@pytest.mark.parametrize(
    ("request_bytes", "status"),
    [
        (b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", 405),
        (b"nonsense\r\n\r\n", 400),
        (b"POST / HTTP/1.1\r\n\r\n", 400),
        (b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 5\r\nContent-Length: 6\r\n\r\n", 400),
        (b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: " + b"9" * 30 + b"\r\n\r\n", 400),
        (b"POST / HTTP/1.1\r\nHost: x\r\n" + b"A: b\r\n" * MAX_HEAD_BYTES, 431),
        (b"POST / HTTP/1.1\r\nHost: " + b"x" * 2 * MAX_HEAD_BYTES, 431),
        (b"POST / HTTP/1.1\r\nHost: x\r\n" + chunked(BODY, b""), 411),
    ],
    ids=["GET", "nonsense", "no host", "two lengths", "no number", "many fields", "long field", "chunks"],
)
def test_what_is_no_request(request_bytes: bytes, status: int) -> None:
    exchange = server()
    with pytest.raises(HttpError) as error:
        exchange.receive_data(request_bytes)
    assert error.value.status == status
    assert exchange.refuse(status).startswith(b"HTTP/1.1 %d " % status)


def request(body: bytes) -> bytes:
    return b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: %d\r\n\r\n%s" % (len(body), body)


@pytest.mark.parametrize(
    "body",
    [b"", b"abc", encode(ANSWER), b" " * (MAX_BODY_BYTES + 1), dumps(("x" * MAX_BODY_BYTES,), "echo").encode()],
    ids=["nothing", "not XML", "an answer", "too long", "too long a call"],
)
def test_what_is_no_call(body: bytes) -> None:
    exchange = server()
    with pytest.raises(XmlRpcError):
        exchange.receive_data(request(body))
    assert exchange.refuse(400).startswith(b"HTTP/1.1 400 ")


def test_announcing_too_much_is_enough() -> None:
    with pytest.raises(XmlRpcError, match="announced"):
        server().receive_data(b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: %d\r\n\r\n" % (MAX_BODY_BYTES + 1))


def test_chunks_over_the_limit() -> None:
    exchange = client()
    assert exchange.receive_data(b"HTTP/1.1 200 OK\r\n" + chunked(*[b" " * 1000] * 4)) is None
    with pytest.raises(XmlRpcError, match="limit"):
        exchange.receive_data(b"3e8\r\n" + b" " * 1000 + b"\r\n")


@pytest.mark.parametrize("sent", [b"P", b"POST / HT", request(BODY)[:-1]], ids=["byte", "half a line", "half a body"])
def test_request_that_ends_early(sent: bytes) -> None:
    exchange = server()
    assert exchange.receive_data(sent) is None
    with pytest.raises(HttpError, match="ended before all of the message came"):
        exchange.receive_data(b"")


@pytest.mark.parametrize("sent", [b"", b"HTTP/1.1 200", b"HTTP/1.1 200 OK\r\nContent-Length: 9\r\n\r\n<met"])
def test_answer_that_ends_early(sent: bytes) -> None:
    exchange = client()
    if sent:
        assert exchange.receive_data(sent) is None
    with pytest.raises(HttpError, match="ended before all of the message came"):
        exchange.receive_data(b"")


def test_stream_that_ends_before_it_begins() -> None:
    exchange = server()
    with pytest.raises(HttpError, match="before anything came"):
        exchange.receive_data(b"")
    assert exchange.refuse(400) == b""


@pytest.mark.parametrize(("host", "target"), [("a\r\nb", "/"), ("ä", "/"), ("x", "/a b"), ("x", "/\n")])
def test_what_cannot_stand_in_a_request(host: str, target: str) -> None:
    with pytest.raises(HttpError):
        client(host, target)


@pytest.mark.parametrize(
    "answer",
    [
        b"HTTP/1.1 404 Not Found\r\n\r\n",
        b"HTTP/1.1 301 Moved\r\nLocation: /\r\n\r\n",
        b"garbage\r\n\r\n",
        b"HTTP/1.1 200 OK\r\n" + b"A: b\r\n" * MAX_HEAD_BYTES,
    ],
    ids=["404", "redirect", "garbage", "many fields"],
)
def test_what_is_no_answer(answer: bytes) -> None:
    with pytest.raises(HttpError):
        client().receive_data(answer)


def test_answer_that_only_its_end_ends() -> None:
    exchange = client()
    assert exchange.receive_data(b"HTTP/1.0 200 OK\r\n\r\n" + encode(ANSWER)) is None
    assert exchange.receive_data(b"") == ANSWER


def test_what_is_discarded_is_freed_at_once() -> None:
    exchange = server()
    exchange.receive_data(request(BODY)[:-1])
    decoder = ref(exchange._decoder._target)
    exchange.close()
    del exchange
    assert decoder() is None


def test_answer_after_a_provisional_one() -> None:
    answer = encode(ANSWER)
    head = b"HTTP/1.1 100 Continue\r\n\r\nHTTP/1.1 200 OK\r\nContent-Length: %d\r\n\r\n" % len(answer)
    assert client().receive_data(head + answer) == ANSWER
