"""Vue templates of workers and gateways."""

from typing import Final

from services.monitor.page.templates import DROPPED, STATE, WHEN

SERVES: Final = """
<span v-if="!props.row.count" class="fs-muted">no camera</span>
<span v-for="camera in props.row.serves" class="fs-chip">{{ camera }}</span>
<span class="fs-muted" v-if="props.row.more">{{ props.row.more }}</span>
<div class="fs-why" v-for="remark in props.row.remarks">{{ remark }}</div>
"""

VERSION: Final = """<div class="fs-why" v-if="props.row.version">version {{ props.row.version }}</div>"""

WORKER_BODY: Final = f"""
<q-tr :props="props" :class="props.row.state === 'online' ? '' : 'fs-stale'" :data-worker="props.row.id">
  <q-td key="state" :props="props">{STATE}</q-td>
  <q-td key="worker" :props="props" class="fs-where"><span class="fs-name">{{{{ props.row.worker }}}}</span
    > <span class="fs-muted">{{{{ props.row.service }}}}</span>{VERSION}</q-td>
  <q-td key="model" :props="props" class="fs-wide">{{{{ props.row.model }}}}</q-td>
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
  <div class="fs-muted fs-small">{{{{ props.row.model }}}}</div>{VERSION}
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
      >nobody asks for it</span></q-td>
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
