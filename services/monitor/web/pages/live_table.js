// A table of Quasar whose rows are templates of ours. NiceGUI's slots would make what is in them anew whenever anything
// in the table changes, and a heading, link or button in it would lose the keyboard's focus each time.
const part = (template) => Vue.markRaw({ props: { props: Object }, template });

export default {
  props: { body: String, card: String, sizes: Array },
  data() {
    return { parts: Vue.markRaw({ body: part(this.body), card: part(this.card) }) };
  },
  template: `
    <q-table>
      <template #header="props">
        <q-tr :props="props">
          <q-th v-for="col in props.cols" :key="col.name" :props="props" :aria-sort="col.order || null">
            <button v-if="col.sortable" type="button" class="fs-sort">{{ col.label }}</button>
            <template v-else>{{ col.label }}</template>
          </q-th>
        </q-tr>
      </template>
      <template #body="props"><component :is="parts.body" :key="props.key" :props="props" /></template>
      <template #item="props"><component :is="parts.card" :key="props.key" :props="props" /></template>
      <template #bottom="{ pagination, pagesNumber, isFirstPage, isLastPage, firstPage, prevPage, nextPage, lastPage }">
        <div class="q-table__separator col"></div>
        <div class="q-table__control">
          <span class="q-table__bottom-item" aria-hidden="true">Rows</span>
          <q-select class="q-table__select inline q-table__bottom-item" dense borderless options-dense options-cover
            aria-label="Rows per page" :options="sizes" :model-value="pagination.rowsPerPage"
            @update:model-value="(size) => $emit('size', size)" />
        </div>
        <div class="q-table__control">
          <span class="q-table__bottom-item">{{ (pagination.page - 1) * pagination.rowsPerPage + 1 }}-{{
            Math.min(pagination.page * pagination.rowsPerPage, pagination.rowsNumber) }} of {{
            pagination.rowsNumber }}</span>
          <template v-if="pagesNumber > 1">
            <q-btn flat round dense size="sm" icon="first_page" aria-label="First page" v-if="pagesNumber > 2"
              :disable="isFirstPage" @click="firstPage" />
            <q-btn flat round dense size="sm" icon="chevron_left" aria-label="Previous page"
              :disable="isFirstPage" @click="prevPage" />
            <q-btn flat round dense size="sm" icon="chevron_right" aria-label="Next page"
              :disable="isLastPage" @click="nextPage" />
            <q-btn flat round dense size="sm" icon="last_page" aria-label="Last page" v-if="pagesNumber > 2"
              :disable="isLastPage" @click="lastPage" />
          </template>
        </div>
      </template>
    </q-table>
  `,
};
