// The page's address: dataset/view/method/score, and after "?" what differs from how the page opens.

import { $, REFERENCE, VIEW, choose, data, photograph, state, summary, viewOf, watch } from "./page.js";

const PARTS = ["dataset", "view", "method", "metric"];
const WORDS = { before: /./, sort: /./, rows: /^(mean|view)$/, mode: /^(slider|panels)$/, layer: /^(picture|holes|confidence|error)$/, guesses: /^(shown|hidden)$/ };
let opened = null; // what the address says before anything is chosen

function decoded(text) {
  try {
    return decodeURIComponent(text);
  } catch {
    return "";
  }
}

// Choose what the address says; false where it names no dataset of the page.
export function readAddress() {
  const [path, words = ""] = location.hash.slice(1).split("?");
  const [dataset, view, method, metric] = path.split("/").map(decoded);
  if (!summary.datasets.includes(dataset)) return false;
  choose({ dataset });
  const isPicture = (which) => [VIEW, REFERENCE].includes(which) || data.methods.some((m) => m.label === which);
  const found = {};
  if (viewOf(view)) found.view = view;
  if (isPicture(method)) found.method = shownAs(method);
  const column = data.columns.find((c) => c.key === metric) || data.columns.find((c) => c.metric === metric);
  if (column) found.metric = column.key;
  const given = new URLSearchParams(words);
  for (const [key, pattern] of Object.entries(WORDS)) if (pattern.test(given.get(key) || "")) found[key] = given.get(key);
  if (found.before && !isPicture(found.before)) delete found.before;
  if (found.before) found.before = shownAs(found.before);
  const panels = given.getAll("panel").filter(isPicture).map(shownAs).slice(0, 4);
  if (panels.length) found.panels = panels;
  choose(found);
  return true;
}

// The photograph has one name: that of the method that returns it, where there is one.
const shownAs = (which) => (which === VIEW ? photograph()[0] : which);

function addressNow() {
  const path = PARTS.map((key) => encodeURIComponent(state[key])).join("/");
  const words = new URLSearchParams();
  for (const key of Object.keys(WORDS)) if (state[key] && state[key] !== START[key]) words.set(key, state[key]);
  if (state.mode === "panels") for (const which of state.panels) words.append("panel", which);
  return `#${path}${words.size ? `?${words}` : ""}`;
}
const START = { sort: "", rows: "mean", mode: "slider", layer: "picture", guesses: "shown" };

watch([...PARTS, ...Object.keys(WORDS), "panels"], () => {
  const now = addressNow();
  if (opened !== null && opened !== now) history.replaceState(null, "", now);
  if (opened !== null) opened = now;
});

// From now on, every choice of the reader goes into the address.
export function keepAddress() {
  opened = addressNow();
}

addEventListener("hashchange", () => {
  if (readAddress()) $("pictures").scrollIntoView();
});
