// What the page knows, what is chosen, and what is drawn anew when that changes.

const $ = (id) => document.getElementById(id);
const $$ = (selector) => [...document.querySelectorAll(selector)];
const summary = JSON.parse($("summary").textContent);
const datasets = $$("script.dataset").map((block) => () => JSON.parse(block.textContent)); // read when first chosen

// Pictures that no method made, beside those that methods did.
const VIEW = "*view";
const REFERENCE = "*reference";

// dataset: its place; view: a name; method, before: right and left of the slider; metric: the score that pictures speak of.
const state = { dataset: -1, view: "", method: "", before: "", metric: "", layer: "picture", guesses: true };
let data = null; // of the dataset that is chosen

function choose(change) {
  const earlier = { ...state };
  Object.assign(state, change);
  if (state.dataset !== earlier.dataset) showDataset();
  chooseKnown();
  const has = (...keys) => keys.some((key) => state[key] !== earlier[key]);
  if (has("dataset", "view", "layer", "guesses")) drawGrid();
  drawStage();
  drawDetail();
  drawLosses();
  drawRankedViews();
  drawCaptions();
  if (earlier.dataset >= 0) keepAddress();
}

// Show a dataset's parts of the page.
function showDataset() {
  const open = datasets[state.dataset];
  data = open();
  datasets[state.dataset] = () => data;
  if ($("dataset")) $("dataset").value = String(state.dataset);
  for (const part of $$("[data-dataset]")) part.hidden = part.dataset.dataset !== String(state.dataset);
  for (const section of $$("section[id]:has([data-dataset])")) section.hidden = !section.querySelector("[data-dataset]:not([hidden])");
  for (const id of ["scores", "charts", "water", "cost"]) if (!$(id).querySelector("[data-dataset]")) $(id).hidden = true;
  $("pictures").hidden = !data.views.some((v) => v.results.some((r) => r.status === "ok"));
  for (const link of $$("nav a")) link.hidden = !$(link.hash.slice(1)) || $(link.hash.slice(1)).hidden;
  fillTable();
}

// Replace what was chosen before, or by an address, and the dataset does not have.
function chooseKnown() {
  const known = [REFERENCE, ...photograph(), ...data.methods.map((m) => m.label)];
  if (!data.columns.some((c) => c.key === state.metric)) state.metric = data.main || data.columns[0]?.key || "";
  if (!known.includes(state.method)) state.method = data.first;
  if (!known.includes(state.before)) state.before = photograph()[0];
  if (!data.views.some((v) => v.name === state.view)) state.view = typicalView();
}

// The photograph: the method that returns it, or the view's own picture where there is no such method.
const photograph = () => (data.photographs.length ? data.photographs : [VIEW]);

// The views that a method has a score of, best first: [view, score].
function viewsByScore(method, key) {
  const row = placeOf(method);
  const sign = columnOf(key)?.better === "lower" ? 1 : -1;
  return data.views
    .map((view) => [view, view.results[row]?.scores?.[key]])
    .filter(([, score]) => score !== null && score !== undefined)
    .sort((a, b) => sign * (a[1] - b[1]));
}

// The median view of the method on the right; the first with pictures where no score knows the colours.
function typicalView() {
  const ranked = data.main ? viewsByScore(state.method, state.metric) : [];
  if (ranked.length) return ranked[Math.floor(ranked.length / 2)][0].name;
  return (data.views.find((v) => v.results.some((r) => r.picture)) || data.views[0])?.name;
}

const placeOf = (label) => data.methods.findIndex((m) => m.label === label);
const viewNow = () => data.views.find((v) => v.name === state.view);
const columnOf = (key) => data.columns.find((c) => c.key === key);

// An element. Text stays text: nothing that a label holds is ever read as markup.
function h(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") made.addEventListener(name, value);
    else if (name === "style") made.style.cssText = value; // as attribute, the page's policy forbids it
    else if (typeof value === "boolean") made.toggleAttribute(name, value);
    else made.setAttribute(name, value);
  }
  made.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return made;
}

function fill(select, options, chosen) {
  select.replaceChildren(...options.map(([value, text]) => h("option", { value }, text)));
  select.value = chosen;
}

// -- words ------------------------------------------------------------------------------------------------

// The text of a number, by the rule of the tables of the command line: the decimals from a size on, and the figures of
// smaller numbers.
function number(value) {
  if (value === null || value === undefined) return "–";
  const size = Math.abs(value);
  if (size >= 1e307) return value > 0 ? "∞" : "−∞";
  if (!size) return "0";
  const { decimals, figures, scientific_below } = summary.numbers;
  const rule = decimals.find(([least]) => size >= least);
  const isSmall = Number(size.toPrecision(figures)) < scientific_below;
  const text = rule ? value.toFixed(rule[1]) : isSmall ? value.toExponential(figures - 1) : value.toPrecision(figures);
  return text.replace(/e-(\d)$/, "e-0$1").replaceAll("-", "−");
}

const percent = (share) => `${share > 0.999 && share < 1 ? "99.9" : Math.round(share * 100)} %`;
const dot = (label) => h("i", { class: `dot m${data.methods[placeOf(label)]?.place}` });

// A score's name, with its variant where a metric has several here.
function titled(column) {
  const several = data.columns.filter((c) => c.metric === column.metric).length > 1;
  return several ? `${column.metric} (${column.variant})` : column.metric;
}

function pictureName(which) {
  if (which === VIEW) return "the photograph";
  if (which === REFERENCE) return "reference, without water";
  return data.photographs.includes(which) ? `${which}, the photograph` : which;
}

// A value of a record in one line.
function briefly(value) {
  if (typeof value === "number") return Number.isInteger(value) ? String(value).replace("-", "−") : number(value);
  if (Array.isArray(value)) return value.map(briefly).join(", ") || "none";
  if (value && typeof value === "object")
    return Object.entries(value).map(([name, inner]) => `${name}: ${briefly(inner)}`).join("; "); // prettier-ignore
  return value === null ? "–" : String(value);
}
