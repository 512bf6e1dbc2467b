"""Vue templates of rows. Text from robots is inserted by `{{ }}` and attributes, never as HTML."""

from typing import Final

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
