"""Formats and Vue templates that all tables share. Pure.

Text from robots is inserted by `{{ }}` and attributes, never as HTML.
"""

from datetime import UTC, datetime
from typing import Final

from services.monitor.fleet import Age

NS: Final = 1_000_000_000
UNITS: Final = ((86_400.0, "d"), (3_600.0, "h"), (60.0, "min"), (1.0, "s"))
NEVER: Final = "never"
NOTHING: Final = "\N{EN DASH}"


def ago(then_ns: int, now_ns: int) -> str:
    """Return the age of a time in its largest unit; `never` for 0. Future times are now."""
    if not then_ns:
        return NEVER
    return f"{lasting((now_ns - then_ns) / NS)} ago" if now_ns - then_ns >= NS else "now"


LATELY_NS: Final = 60 * NS


def seen_lately(then_ns: int, now_ns: int) -> str:
    """Return the age of an object, whose world model tells of it again every ten seconds or so while it is in view."""
    return "now" if now_ns - then_ns < LATELY_NS else ago(then_ns, now_ns)


def lasting(seconds: float) -> str:
    """Return a duration in whole units, of the largest that fits; 0 s below a second."""
    for size, unit in UNITS:
        if seconds >= size:
            return f"{int(seconds // size)} {unit}"
    return "0 s"


def age_text(age: Age | None) -> str:
    """Return an age, to a tenth of a second up to ten, with `>` where only a lower bound is known."""
    if age is None:
        return NOTHING
    bound = "" if age.exact else "> "
    return f"{bound}{age.seconds:.1f} s" if age.seconds < 10 else bound + lasting(age.seconds)


def brief(count: int) -> str:
    """Return a count in at most four characters up to a thousand million: 950, 1.2k, 34k, 5.6M."""
    for size, unit in ((1_000_000, "M"), (1_000, "k")):
        if count >= size:
            value = count / size
            return f"{value:.1f}{unit}" if value < 9.95 else f"{value:.0f}{unit}"
    return str(count)


def rate_text(hz: float) -> str:
    """Return a rate; an en dash if there is none."""
    return f"{hz:.1f}/s" if hz > 0 else NOTHING


def iso(at_ns: int) -> str:
    """Return a time as ISO 8601 in UTC with milliseconds, which the browser shows in its own zone; empty for 0."""
    if not at_ns:
        return ""
    return datetime.fromtimestamp(at_ns / NS, UTC).isoformat(timespec="milliseconds")


def plural(count: int, one: str, many: str = "") -> str:
    """Return a count and its noun: 1 camera, 2 cameras, 1,200 classes."""
    return f"{count:,} {one if count == 1 else many or one + 's'}"


WHEN: Final = """:title="{at} ? new Date({at}).toLocaleString() : ''\""""
"""An attribute that shows a time in the browser's own zone."""

STATE: Final = """
<span :class="'fs-state fs-' + props.row.state"
  ><span :class="'fs-dot fs-' + props.row.state"></span>{{ props.row.state }}</span>
<div class="fs-why" v-if="props.row.why">{{ props.row.why }}</div>
"""

FORGET: Final = """
<q-btn v-if="props.row.forgettable" flat dense no-caps color="primary" class="q-px-sm" label="forget"
  @click="$parent.$emit('forget', props.row.robot)" :aria-label="'forget ' + props.row.robot" />
"""

DROPPED: Final = """
<span v-if="props.row.dropped">{{ props.row.dropped }}<q-tooltip class="fs-tip">
  <div v-for="reason in props.row.reasons">{{ reason[0].toLocaleString() }} {{ reason[1] }}</div>
</q-tooltip></span><span v-else class="fs-muted">&ndash;</span>
"""

IN_VIEW: Final = """
<span v-if="camera.classes === null" class="fs-muted"
  >{{ camera.online ? 'waiting for class lists' : 'not known' }}</span>
<span v-else-if="!camera.classes.length" class="fs-muted">nothing in view</span>
<span v-else v-for="seen in camera.classes" class="fs-chip"><b>{{ seen[0] }}</b>{{ seen[1] }}</span>
"""

NO_CAMERA: Final = "no camera is published; run fleetsight doctor on the robot to see why"

CAMERA: Final = """
<a class="fs-link" :href="'/cameras/' + encodeURIComponent(props.row.robot) + '/' + encodeURIComponent(camera.name)"
  >{{ camera.name }}</a>
<a class="fs-link fs-small fs-3d" title="objects in 3D" :href="'/objects/' + encodeURIComponent(props.row.robot) + '/' +
  encodeURIComponent(camera.name)">3D</a>
"""

ROBOT_BODY: Final = f"""
<q-tr v-for="(camera, n) in (props.row.cameras.length ? props.row.cameras : [null])" :key="props.row.robot + '/' + n"
    :props="props" :class="n ? 'fs-more' : ''" :data-robot="props.row.robot">
  <q-td v-if="n === 0" key="state" class="fs-where" :rowspan="props.row.cameras.length || 1">{STATE}{FORGET}</q-td>
  <q-td v-if="n === 0" key="robot" class="fs-name" :rowspan="props.row.cameras.length || 1"
    >{{{{ props.row.robot }}}}<div class="fs-why" v-if="props.row.more">{{{{ props.row.more }}}}</div></q-td>
  <template v-if="camera">
    <q-td class="fs-where">{CAMERA}</q-td>
    <q-td :class="camera.live ? 'fs-wide' : 'fs-wide fs-stale'">{IN_VIEW}</q-td>
    <q-td :class="camera.live ? 'text-right' : 'text-right fs-stale'">{{{{ camera.age }}}}</q-td>
    <q-td :class="camera.live ? 'text-right' : 'text-right fs-stale'">{{{{ camera.rate }}}}</q-td>
  </template>
  <q-td v-else colspan="4" class="fs-muted">{NO_CAMERA}</q-td>
  <q-td v-if="n === 0" class="text-right" :rowspan="props.row.cameras.length || 1">{DROPPED}</q-td>
  <q-td v-if="n === 0" class="text-right" :rowspan="props.row.cameras.length || 1"
    {WHEN.format(at="props.row.seen_at")}>{{{{ props.row.seen }}}}</q-td>
</q-tr>
"""

ROBOT_CARD: Final = f"""
<div class="fs-card" :data-robot="props.row.robot">
  <div class="fs-top"><strong>{{{{ props.row.robot }}}}</strong
    ><span class="fs-muted fs-small">{{{{ props.row.seen }}}}</span></div>
  <div>{STATE}{FORGET}</div>
  <div v-for="camera in props.row.cameras" :class="camera.live ? 'fs-camera' : 'fs-camera fs-stale'">
    <div class="fs-top"><span>{CAMERA}</span
      ><span class="fs-small">{{{{ camera.age }}}} &middot; {{{{ camera.rate }}}}</span></div>
    <div>{IN_VIEW}</div>
  </div>
  <div class="fs-muted" v-if="!props.row.cameras.length">{NO_CAMERA}</div>
  <div class="fs-why" v-if="props.row.more">{{{{ props.row.more }}}}</div>
  <div class="fs-muted fs-small" v-if="props.row.dropped">{{{{ props.row.dropped }}}} frames dropped</div>
</div>
"""
