"""Vue templates of workers and gateways. Pure."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Final

from schemas.header import MAX_COUNT
from schemas.status import StreamStatus, WorkerStatus
from services.monitor.formats import natural
from services.monitor.liveness import RobotState
from services.monitor.snapshot import WorkerLine
from services.monitor.web.pages.rows.formatting import DROPPED, NOTHING, NS, STATE, WHEN, ago, brief, iso, rate_text
from services.monitor.web.pages.rows.robots import RobotRow

MAX_SHOWN: Final = 12
"""Maximum number of a worker's cameras, and of a gateway's streams, that are shown."""


class WorkerRates:
    """Frames per second processed by each worker, between its last two status messages."""

    def __init__(self) -> None:
        self._last: dict[str, WorkerStatus] = {}
        self._rates: dict[str, float] = {}

    def take(self, workers: Sequence[WorkerLine]) -> Mapping[str, float]:
        """Take the newest status of every worker; return the known rates by worker."""
        rates = {worker.name: self._rate_of(worker) for worker in workers if worker.online}
        self._rates = {name: rate for name, rate in rates.items() if rate is not None}
        self._last = {worker.name: worker.status for worker in workers}
        return self._rates

    def _rate_of(self, worker: WorkerLine) -> float | None:
        before, now = self._last.get(worker.name), worker.status
        if before is None or now.sent_ns <= before.sent_ns:
            return self._rates.get(worker.name)
        return max(0.0, (inferred(now) - inferred(before)) * NS / (now.sent_ns - before.sent_ns))


def inferred(status: WorkerStatus) -> int:
    """Return the number of frames that a worker has processed since its start."""
    return sum(load.inferred for load in status.cameras)


def worker_row(worker: WorkerLine, rate_hz: float, now_ns: int) -> dict[str, Any]:
    """Return a worker as a row of the health page's template."""
    dropped = Counter[str]()
    for load in worker.status.cameras:
        dropped.update(load.dropped)
    serves = [
        f"{load.robot}/{load.camera}" + (f" at {load.budget_hz:.3g}/s" if load.budget_hz is not None else "")
        for load in worker.serves
    ]
    return {
        "id": worker.name,
        "state": RobotState.ONLINE if worker.online else RobotState.OFFLINE,
        "service": worker.status.service,
        "worker": worker.status.worker,
        "version": worker.status.version,
        "model": worker.status.model or NOTHING,
        "runtime": worker.status.runtime,
        "count": len(serves),
        "serves": sorted(serves, key=natural)[:MAX_SHOWN],
        "more": f"and {len(serves) - MAX_SHOWN} more" if len(serves) > MAX_SHOWN else "",
        "rate": rate_text(rate_hz),
        "frames": brief(inferred(worker.status)),
        "remarks": list(worker.status.remarks),
        "seen": "now" if worker.online else ago(worker.last_ns, now_ns),
        "seen_at": iso(worker.last_ns),
        **dropped_cells(dropped),
    }


def gateway_row(robot: RobotRow, now_ns: int) -> dict[str, Any]:
    """Return a robot's gateway with its streams as a row of the health page's template."""
    live = robot.line.online
    served = {camera.key.camera: camera.served_by for camera in robot.cameras}
    streams = robot.line.gateway.streams if robot.line.gateway else []
    return {
        "robot": robot.line.name,
        "version": robot.line.gateway.version if robot.line.gateway else "",
        "state": robot.state,
        "why": robot.why,
        "seen": ago(robot.line.last_ns, now_ns),
        "live": live,
        "streams": tuple(_stream(stream, served, live=live) for stream in streams[:MAX_SHOWN]),
        "more": f"and {len(streams) - MAX_SHOWN} more streams" if len(streams) > MAX_SHOWN else "",
    }


def dropped_cells(dropped: Mapping[str, int]) -> dict[str, Any]:
    """Return drops for the templates: their sum, and each reason, the most frequent first."""
    reasons = sorted(((min(count, MAX_COUNT), reason) for reason, count in dropped.items() if count), reverse=True)
    return {"dropped": brief(sum(count for count, _ in reasons)) if reasons else "", "reasons": tuple(reasons)}


def _stream(stream: StreamStatus, served: Mapping[str, tuple[str, ...]], *, live: bool) -> dict[str, Any]:
    return {
        "name": stream.name,
        "topic": stream.topic,
        "wanted": live and stream.wanted,
        "in": rate_text(stream.received_hz if live else 0.0),
        "out": rate_text(stream.forwarded_hz if live else 0.0),
        "compression": stream.compression,
        "problem": stream.problem,
        "served": ", ".join(served.get(stream.camera, ())) if stream.stream == "color" else "",
        **dropped_cells(stream.dropped),
    }


SERVES: Final = """
<span v-if="!props.row.count" class="fs-muted">no camera</span>
<span v-for="camera in props.row.serves" class="fs-chip">{{ camera }}</span>
<span class="fs-muted" v-if="props.row.more">{{ props.row.more }}</span>
<div class="fs-why" v-for="remark in props.row.remarks">{{ remark }}</div>
"""

VERSION: Final = """<div class="fs-why" v-if="props.row.version">version {{ props.row.version }}</div>"""

RUNTIME: Final = """<div class="fs-muted fs-small" v-if="props.row.runtime">{{ props.row.runtime }}</div>"""

WORKER_BODY: Final = f"""
<q-tr :props="props" :class="props.row.state === 'online' ? '' : 'fs-stale'" :data-worker="props.row.id">
  <q-td key="state" :props="props">{STATE}</q-td>
  <q-td key="worker" :props="props" class="fs-where"><span class="fs-name">{{{{ props.row.worker }}}}</span
    > <span class="fs-muted">{{{{ props.row.service }}}}</span>{VERSION}</q-td>
  <q-td key="model" :props="props" class="fs-wide">{{{{ props.row.model }}}}{RUNTIME}</q-td>
  <q-td key="count" :props="props" class="fs-wide">{SERVES}</q-td>
  <q-td key="rate" :props="props">{{{{ props.row.rate }}}}</q-td>
  <q-td key="frames" :props="props">{{{{ props.row.frames }}}}</q-td>
  <q-td key="dropped" :props="props">{DROPPED}</q-td>
  <q-td key="seen" :props="props" {WHEN.format(at="props.row.seen_at")}>{{{{ props.row.seen }}}}</q-td>
</q-tr>
"""

WORKER_CARD: Final = f"""
<div :class="props.row.state === 'online' ? 'fs-card' : 'fs-card fs-stale'" :data-worker="props.row.id">
  <div class="fs-top"><span><strong>{{{{ props.row.worker }}}}</strong> {{{{ props.row.service }}}}</span>
    <span class="fs-small">{{{{ props.row.rate }}}}</span></div>
  <div class="fs-top"><span>{STATE}</span><span class="fs-muted fs-small">{{{{ props.row.seen }}}}</span></div>
  <div class="fs-muted fs-small">{{{{ props.row.model }}}}{RUNTIME}</div>{VERSION}
  <div>{SERVES}</div>
</div>
"""

STREAM_DROPPED: Final = DROPPED.replace("props.row.", "stream.")

PROBLEM: Final = """<div class="fs-problem fs-small" v-if="stream.problem">{{ stream.problem }}</div>"""

GATEWAY_BODY: Final = f"""
<q-tr v-for="(stream, n) in (props.row.streams.length ? props.row.streams : [null])" :key="props.row.robot + '/' + n"
    :props="props" :class="(n ? 'fs-more' : '') + (props.row.live ? '' : ' fs-stale')" :data-gateway="props.row.robot">
  <q-td v-if="n === 0" class="fs-where" :rowspan="props.row.streams.length || 1">{STATE}</q-td>
  <q-td v-if="n === 0" class="fs-where" :rowspan="props.row.streams.length || 1"
    ><span class="fs-name">{{{{ props.row.robot }}}}</span>{VERSION}
    <div class="fs-why" v-if="props.row.more">{{{{ props.row.more }}}}</div></q-td>
  <template v-if="stream">
    <q-td class="fs-where">{{{{ stream.name }}}}</q-td>
    <q-td class="fs-wide">{{{{ stream.topic }}}}{PROBLEM}</q-td>
    <q-td class="text-right">{{{{ stream.in }}}}</q-td>
    <q-td class="fs-where text-right">{{{{ stream.out }}}}
      <span class="fs-muted">{{{{ stream.compression }}}}</span></q-td>
    <q-td class="text-right">{STREAM_DROPPED}</q-td>
    <q-td class="fs-wide">{{{{ stream.served }}}} <span class="fs-muted" v-if="props.row.live && !stream.wanted"
      >not requested</span></q-td>
  </template>
  <q-td v-else colspan="6" class="fs-muted">it offers no streams</q-td>
</q-tr>
"""

GATEWAY_CARD: Final = f"""
<div :class="props.row.live ? 'fs-card' : 'fs-card fs-stale'" :data-gateway="props.row.robot">
  <div class="fs-top"><strong>{{{{ props.row.robot }}}}</strong
    ><span class="fs-muted fs-small">{{{{ props.row.seen }}}}</span></div>
  <div>{STATE}</div>{VERSION}
  <div v-for="stream in props.row.streams" class="fs-camera">
    <div class="fs-top"><span>{{{{ stream.name }}}}</span><span class="fs-small">{{{{ stream.in }}}} &rarr;
      {{{{ stream.out }}}}</span></div>
    <div class="fs-muted fs-small">{{{{ stream.topic }}}} {{{{ stream.served }}}}</div>{PROBLEM}
  </div>
</div>
"""
