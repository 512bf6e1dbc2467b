"""Vue templates of the inventory's rows."""

from typing import Final

from services.monitor.page.templates import WHEN

CHOOSE: Final = "$parent.$emit('choose', [props.row.robot, props.row.camera, props.row.name])"

LIVE_VIEW: Final = """<a class="fs-link"
  :href="'/cameras/' + encodeURIComponent(props.row.robot) + '/' + encodeURIComponent(props.row.camera)"
  >{{ props.row.camera }}</a>"""

SIGHTING_BODY: Final = f"""
<q-tr :props="props" :class="props.row.available ? '' : 'fs-stale'" :data-sighting="props.row.id">
  <q-td key="robot" :props="props" class="fs-name">{{{{ props.row.robot }}}}</q-td>
  <q-td key="camera" :props="props" class="fs-where">{LIVE_VIEW}</q-td>
  <q-td key="name" :props="props" class="fs-wide"><button class="fs-link" title="over time" @click="{CHOOSE}"
    >{{{{ props.row.name }}}}</button></q-td>
  <q-td key="count" :props="props"><b>{{{{ props.row.count }}}}</b></q-td>
  <q-td key="score" :props="props">{{{{ props.row.score }}}}</q-td>
  <q-td key="nearest" :props="props">{{{{ props.row.nearest }}}}</q-td>
  <q-td key="first" :props="props" {WHEN.format(at="props.row.first_at")}>{{{{ props.row.first }}}}</q-td>
  <q-td key="last" :props="props" {WHEN.format(at="props.row.last_at")}>{{{{ props.row.last }}}}</q-td>
  <q-td key="worker" :props="props" class="fs-wide"
    >{{{{ props.row.worker }}}} <span class="fs-muted">{{{{ props.row.model }}}}</span></q-td>
</q-tr>
"""

SIGHTING_CARD: Final = f"""
<div :class="props.row.available ? 'fs-card' : 'fs-card fs-stale'" :data-sighting="props.row.id">
  <div class="fs-top"><span><button class="fs-chip" @click="{CHOOSE}"><b>{{{{ props.row.count }}}}</b
    >{{{{ props.row.name }}}}</button></span><span class="fs-small">{{{{ props.row.nearest }}}}</span></div>
  <div class="fs-top"><span><strong>{{{{ props.row.robot }}}}</strong> {LIVE_VIEW}</span
    ><span class="fs-muted fs-small">{{{{ props.row.last }}}}</span></div>
  <div class="fs-muted fs-small">{{{{ props.row.score }}}}, first seen {{{{ props.row.first }}}},
    {{{{ props.row.worker }}}} {{{{ props.row.model }}}}</div>
</div>
"""
