// What the page knows, what is chosen, and who draws it anew when that changes.

export const $ = (id) => document.getElementById(id);
export const summary = JSON.parse($("summary").textContent);
const blocks = [...document.querySelectorAll("script.dataset")];
const parsed = new Map();

// Pictures that no method made, beside those that methods did.
export const VIEW = "*view";
export const REFERENCE = "*reference";

// dataset, view: names; method, before: right and left of the slider; metric: the score that pictures and plots speak of.
export const state = {
  dataset: "",
  view: "",
  method: "",
  before: "",
  metric: "",
  chart: "",
  layer: "picture",
  guesses: "shown", // or "hidden": the colours that fill=true guessed
  mode: "slider", // or "panels": up to four pictures in step
  panels: [], // their names
  rows: "mean",
  sort: "", // a column's key, "-" before it: from the greatest down
  filter: "",
  unshown: new Set(summary.columns.filter((c) => !c.directed && !c.cost).map((c) => c.key)), // what only describes
  hidden: new Set(),
  theme: "",
};
const watchers = [];
export const data = {}; // of the dataset that is chosen

// Draw when one of these changes, and at once.
export function watch(keys, draw) {
  watchers.push([keys, draw]);
}

export function choose(change) {
  const changed = new Set(Object.keys(change).filter((key) => state[key] !== change[key]));
  if (!changed.size) return;
  Object.assign(state, change);
  if (changed.has("dataset")) {
    openDataset(state.dataset);
    for (const key of Object.keys(state)) changed.add(key);
  }
  for (const [keys, draw] of watchers) if (keys.some((key) => changed.has(key))) draw();
}

// Read a dataset's block, once, and choose what it has of what was chosen before.
function openDataset(name) {
  const at = Math.max(0, summary.datasets.indexOf(name));
  if (!parsed.has(at)) parsed.set(at, JSON.parse(blocks[at].textContent));
  Object.assign(data, parsed.get(at));
  state.dataset = data.name;
  const labels = data.methods.map((m) => m.label);
  const views = data.views.map((v) => v.name);
  if (!data.columns.some((c) => c.key === state.metric))
    state.metric = data.main || (data.columns[0] || { key: "" }).key;
  const [best, second] = byScore(state.metric);
  const known = [REFERENCE, ...photograph(), ...labels];
  if (!known.includes(state.method)) state.method = best || labels[0] || "";
  if (!known.includes(state.before)) state.before = second || photograph()[0];
  if (!views.includes(state.view)) state.view = typicalView(state.method, state.metric) || views[0] || "";
  state.panels = state.panels.filter((which) => known.includes(which));
  if (!state.panels.length) state.panels = startPanels(best, second);
}

// The photograph: the method that returns it, or the view's own picture where there is no such method.
export const photograph = () => (data.photographs.length ? data.photographs : [VIEW]);

function startPanels(best, second) {
  const reference = data.views.some((v) => v.reference) ? [REFERENCE] : [];
  const wanted = [photograph()[0], second, best, ...reference].filter(Boolean);
  return [...new Set(wanted)].slice(0, 4);
}

// The methods by their mean, best first, without the photograph and those without a score; as asked by a score of the
// picture alone, where nothing knows the true colours.
export function byScore(key) {
  const at = data.columns.findIndex((c) => c.key === key);
  if (at < 0) return [];
  if (data.columns[at].directed && !data.columns[at].ranked)
    return data.methods.map((m) => m.label).filter((label) => !data.photographs.includes(label));
  const sign = data.columns[at].better === "lower" ? 1 : -1;
  const scored = data.methods
    .map((m, row) => [m.label, data.cells[row][at]?.mean])
    .filter(([label, mean]) => mean !== null && mean !== undefined && !data.photographs.includes(label));
  return scored.sort((a, b) => sign * (a[1] - b[1])).map(([label]) => label);
}

// The views that a method has a score of, best first: [view, score].
export function viewsByScore(method, key) {
  const row = data.methods.findIndex((m) => m.label === method);
  const sign = columnOf(key)?.better === "lower" ? 1 : -1;
  return data.views
    .map((view) => [view, row < 0 ? null : view.results[row].scores?.[key]])
    .filter(([, score]) => score !== null && score !== undefined)
    .sort((a, b) => sign * (a[1] - b[1]));
}

// The median view of a method; the first with pictures where it has no scores.
function typicalView(method, key) {
  const ranked = viewsByScore(method, key);
  if (ranked.length) return ranked[Math.floor(ranked.length / 2)][0].name;
  return data.views.find((v) => v.results.some((r) => r.picture))?.name;
}

export const viewOf = (name) => data.views.find((v) => v.name === name);
export const roleOf = (key) => summary.roles[key.split(":")[0]] || "";
export const columnOf = (key) => data.columns.find((c) => c.key === key);
export const directed = () => data.columns.filter((c) => c.directed);
export const shownMethods = () => data.methods.map((m, at) => ({ ...m, at })).filter((m) => !state.hidden.has(m.label));

// An element. Text stays text: nothing that a label holds is ever read as markup.
export function h(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") made.addEventListener(name, value);
    else if (name === "style") made.style.cssText = value; // as attribute, the page's policy forbids it
    else if (typeof value === "boolean") made.toggleAttribute(name, value);
    else if (value !== null && value !== undefined) made.setAttribute(name, value);
  }
  made.append(...children.flat().filter((child) => child !== null && child !== undefined && child !== ""));
  return made;
}

export function fill(select, options, chosen) {
  select.replaceChildren(...options.map(([value, text]) => h("option", { value, selected: value === chosen }, text)));
  select.value = chosen;
}

// -- pictures ---------------------------------------------------------------------------------------------

const urls = new Map();

// The address of a picture in the page, decoded when it is first asked for; null where the page has none.
export function embedded(id) {
  const block = id && $(id);
  if (!block) return null;
  if (!urls.has(id)) {
    const bytes = Uint8Array.from(atob(block.textContent), (letter) => letter.charCodeAt(0));
    urls.set(id, URL.createObjectURL(new Blob([bytes], { type: block.dataset.kind })));
  }
  return urls.get(id);
}

export const address = (picture) => picture && (embedded(picture.id) || picture.link);
