"""Vue templates of alerts."""

from typing import Final

from services.monitor.page.templates import WHEN

SEVERITY: Final = """<span :class="'fs-severity fs-' + props.row.severity">{{ props.row.severity }}</span>"""

WHERE: Final = """
<a v-if="props.row.camera" class="fs-link"
  :href="'/cameras/' + encodeURIComponent(props.row.robot) + '/' + encodeURIComponent(props.row.camera)"
  ><b>{{ props.row.robot }}</b>/{{ props.row.camera }}</a><b v-else>{{ props.row.robot }}</b>
"""

DEEDS: Final = """
<q-btn v-for="deed in props.row.deeds" :key="deed" flat dense no-caps color="primary" class="q-px-sm" :label="deed"
  @click="$parent.$emit('deed', [deed, props.row.id])" :aria-label="deed + ' ' + props.row.text" />
"""

SAID: Final = """
<div>{{ props.row.text }}</div>
<div v-if="props.row.doubt">{{ props.row.doubt }}</div>
<div class="fs-why">{{ props.row.rule }}</div>
<div class="fs-why" v-for="act in props.row.acts">{{ act }}</div>
"""

OPEN_BODY: Final = f"""
<q-tr :props="props" :class="props.row.doubt ? 'fs-stale' : ''" :data-alert="props.row.id">
  <q-td key="severity" :props="props">{SEVERITY}</q-td>
  <q-td key="text" :props="props" class="fs-wide">{SAID}</q-td>
  <q-td key="robot" :props="props" class="fs-where">{WHERE}</q-td>
  <q-td key="state" :props="props">{{{{ props.row.state }}}}</q-td>
  <q-td key="raised" :props="props" {WHEN.format(at="props.row.raised_at")}>{{{{ props.row.raised }}}}</q-td>
  <q-td key="deeds" :props="props" class="fs-deeds">{DEEDS}</q-td>
</q-tr>
"""

ENDED_BODY: Final = f"""
<q-tr :props="props" :data-alert="props.row.id">
  <q-td key="severity" :props="props">{SEVERITY}</q-td>
  <q-td key="text" :props="props" class="fs-wide">{SAID}</q-td>
  <q-td key="robot" :props="props" class="fs-where">{WHERE}</q-td>
  <q-td key="raised" :props="props" {WHEN.format(at="props.row.raised_at")}>{{{{ props.row.raised }}}}</q-td>
  <q-td key="ended" :props="props" {WHEN.format(at="props.row.ended_at")}>{{{{ props.row.ended }}}}</q-td>
</q-tr>
"""

CARD: Final = f"""
<div :class="props.row.doubt ? 'fs-card fs-stale' : 'fs-card'" :data-alert="props.row.id">
  <div class="fs-top"><span>{SEVERITY} <span class="fs-muted fs-small">{{{{ props.row.state }}}}</span></span>
    <span class="fs-muted fs-small">{{{{ props.row.ended || props.row.raised }}}}</span></div>
  <div>{SAID}</div>
  <div class="fs-top"><span>{WHERE}</span></div>
  <div v-if="props.row.deeds.length" class="fs-deeds">{DEEDS}</div>
</div>
"""
