// Tables to sort and filter. The page has their rows; those of every view are made from its data when they are shown.

const MOST_ROWS = 200;
const sheets = new Map(); // by table: {rows, order, most}; a row: {values, words, isLast, element()}

for (const table of $$("table.sheet")) {
  const heads = [...table.tHead.rows[0].cells];
  const at = heads.findIndex((head) => head.ariaSort !== "none");
  const order = at < 0 ? null : { at, down: heads[at].ariaSort === "descending" };
  const rows = [...table.tBodies[0].rows].map((row) => ({
    values: [...row.cells].map(valueOf),
    words: row.cells[0].textContent,
    isLast: row.classList.contains("photograph"),
    element: () => row,
  }));
  sheets.set(table, { rows, order, most: MOST_ROWS });
  for (const head of heads) head.querySelector("button").addEventListener("click", () => sort(table, head));
}

function valueOf(cell) {
  const { value } = cell.dataset;
  if (value === undefined) return cell.textContent;
  return value === "" ? null : Number(value.replace("inf", "Infinity"));
}

function sort(table, head) {
  const sheet = sheets.get(table);
  const isAgain = sheet.order?.at === head.cellIndex;
  sheet.order = { at: head.cellIndex, down: isAgain ? !sheet.order.down : head.dataset.better === "higher" };
  for (const cell of head.parentElement.cells) cell.ariaSort = "none";
  head.ariaSort = sheet.order.down ? "descending" : "ascending";
  arrange(table);
  if (head.dataset.key) choose({ metric: head.dataset.key });
}

// Lay out a table's rows in their order, those that the filter keeps.
function arrange(table) {
  const { rows, order, most } = sheets.get(table);
  const wanted = table.closest("#scores") ? $("filter").value.toLowerCase().split(/\s+/) : [];
  const kept = rows.filter((row) => wanted.every((word) => row.words.toLowerCase().includes(word)));
  if (order) kept.sort((a, b) => (a.isLast || false) - (b.isLast || false) || compared(a.values[order.at], b.values[order.at], order.down));
  table.tBodies[0].replaceChildren(...kept.slice(0, most).map((row) => row.element()));
  const place = table.parentElement;
  for (const old of [...place.parentElement.children]) if (old.matches(".after-rows")) old.remove();
  const more = () => {
    sheets.get(table).most += 1000;
    arrange(table);
  };
  if (!kept.length) place.after(h("p", { class: "note after-rows" }, "Nothing matches the filter."));
  else if (kept.length > most)
    place.after(h("button", { type: "button", class: "after-rows", click: more }, `${kept.length - most} more rows`));
}

// Holes are last, whichever way.
function compared(a, b, down) {
  const none = [a, b].map((x) => x === null || x === undefined);
  if (none[0] || none[1]) return none[0] - none[1];
  const order = typeof a === "string" ? a.localeCompare(b, undefined, { numeric: true }) : a - b;
  return down ? -order : order;
}

// -- every view --------------------------------------------------------------------------------------------

function fillTable() {
  const table = document.querySelector(`#scores [data-dataset="${state.dataset}"] table.views`);
  if (!table || sheets.get(table).rows.length) return;
  const heads = [...table.tHead.rows[0].cells].slice(2);
  sheets.get(table).rows = data.views.flatMap((view) =>
    data.methods.map((method, at) => {
      const result = view.results[at];
      const isOk = result.status === "ok";
      return {
        values: [view.name, method.label, ...heads.map((head) => result.scores?.[head.dataset.key])],
        words: `${view.name} ${method.label} ${isOk ? "" : result.status} ${result.reason || ""}`,
        element: () => rowOf(view, method, result, heads),
      };
    }),
  );
  arrange(table);
}

function rowOf(view, method, result, heads) {
  const open = { type: "button", class: "plain", "data-view": view.name, "data-method": method.label, title: "show its pictures" };
  const cells = heads.map((head) => {
    const kind = head.className;
    if (result.status !== "ok")
      return h("td", { class: `hole ${kind}`, title: `${result.status}: ${result.reason}` }, result.status);
    const [value, covered] = [result.scores[head.dataset.key], result.covers[head.dataset.key]];
    const below = covered === undefined ? null : h("small", {}, `of ${percent(covered)}`);
    return h("td", { class: kind }, number(value), below);
  });
  const name = h("th", { scope: "row" }, h("button", open, view.name));
  return h("tr", {}, name, h("td", { class: "text" }, dot(method.label), method.label), cells);
}

for (const button of $$("[data-rows]"))
  button.addEventListener("click", () => {
    for (const other of $$("[data-rows]")) other.ariaPressed = String(other === button);
    for (const table of $$("[data-table]")) table.hidden = table.dataset.table !== button.dataset.rows;
  });
$("filter").addEventListener("input", () => $$("#scores table.sheet").forEach(arrange));
$("all").addEventListener("change", (event) => $("scores").classList.toggle("all", event.currentTarget.checked));
