// The entry of the page: its address, keys, light and dark, and the start.

import { $, REFERENCE, VIEW, choose, data, h, photograph, state, summary, viewOf, watch } from "./page.js";
import { briefly, commandBox, commandFor, dot, number } from "./words.js";
import "./sortable_table.js";
import "./verdicts.js";
import "./scores.js";
import { setZoom, zoom, zoomAt } from "./zoom.js";
import { step, swap } from "./pictures.js";
import "./detail.js";
import "./grid.js";
import "./choices.js";
import "./panels.js";
import { pictureOfView } from "./downloads.js";
import "./charts.js";
import { isDark } from "./plots.js";
import "./cost.js";
import "./distances.js";
import "./water.js";
import "./sweep.js";

// -- the address names dataset/view/method/score, and after "?" what differs from how the page opens ------------------

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

function readAddress() {
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
addEventListener("hashchange", () => {
  if (readAddress()) $("pictures").scrollIntoView();
});

// Links within the page do not touch the address: it is taken.
for (const link of document.querySelectorAll("[data-to]")) {
  link.href = `#${link.dataset.to}`;
  link.addEventListener("click", (event) => {
    event.preventDefault();
    const target = $(link.dataset.to);
    target.scrollIntoView({ behavior: matchMedia("(prefers-reduced-motion: reduce)").matches ? "auto" : "smooth" });
    target.setAttribute("tabindex", "-1");
    target.focus({ preventScroll: true });
  });
}

// -- light and dark ---------------------------------------------------------------------------------------------

function setTheme(theme) {
  if (theme) document.documentElement.dataset.theme = theme;
  try {
    localStorage.setItem("sucre_bench theme", theme);
  } catch {
    /* a page from disk may keep nothing */
  }
  choose({ theme: theme || "system" });
}
const switchTheme = () => setTheme(isDark() ? "light" : "dark");
$("theme").addEventListener("click", switchTheme);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => choose({ theme: String(Date.now()) }));

// -- keys -----------------------------------------------------------------------------------------------------------

$("help").addEventListener("click", () => $("keys").showModal());
addEventListener("keydown", (event) => {
  const typing = event.target.closest("input:not([type=checkbox]), select, textarea, dialog");
  if (event.key === "Escape" && event.target === $("filter")) {
    $("filter").value = "";
    choose({ filter: "" });
    $("filter").blur();
  }
  if (typing || event.ctrlKey || event.metaKey) return;
  const digit = /^Digit([1-9])$/.exec(event.code);
  const keys = {
    "/": () => {
      $("scores").scrollIntoView();
      $("filter").focus();
    },
    "?": () => $("keys").showModal(),
    "[": () => step(-1),
    "]": () => step(1),
    x: swap,
    f: () => $("guesses-pick").hidden || $("guesses").click(),
    s: () => choose({ mode: state.mode === "slider" ? "panels" : "slider" }),
    d: switchTheme,
    "+": () => zoomAt(1.5),
    "=": () => zoomAt(1.5),
    "-": () => zoomAt(1 / 1.5),
    0: () => setZoom(1, 0, 0),
  };
  const act =
    keys[event.key] ||
    (digit &&
      (() => {
        const method = data.methods[digit[1] - 1];
        if (method) choose(event.altKey ? { before: method.label } : { method: method.label });
      }));
  if (!act) return;
  event.preventDefault();
  act();
});
addEventListener("click", (event) => {
  // a menu closes when one goes on elsewhere
  for (const menu of document.querySelectorAll("details.menu[open]"))
    if (!menu.contains(event.target)) menu.open = false;
});
// Printed, everything is shown that is folded away.
addEventListener("beforeprint", () => {
  for (const folded of document.querySelectorAll("main details:not(.menu)")) folded.open = true;
});

// Nothing leads to what is not there.
watch(["dataset", "view"], () => {
  for (const link of document.querySelectorAll("[data-to]"))
    link.hidden = !$(link.dataset.to) || $(link.dataset.to).hidden;
});

// -- each method's command -----------------------------------------------------------------------------------------

watch(["dataset"], () =>
  $("commands").replaceChildren(
    ...data.methods.map((m) =>
      h(
        "div",
        { class: "again" },
        h("h4", {}, dot(m.label), m.label),
        commandBox(commandFor(m, null)),
        h(
          "details",
          {},
          h("summary", {}, "All its options"),
          h(
            "dl",
            { class: "scores" },
            Object.entries(m.options).map(([name, value]) =>
              h("div", {}, h("dt", {}, name), h("dd", {}, briefly(value))),
            ),
          ),
        ),
      ),
    ),
  ),
);

// -- the start -------------------------------------------------------------------------------------------------------

if (summary.datasets.length) {
  try {
    const kept = localStorage.getItem("sucre_bench theme");
    if (kept) document.documentElement.dataset.theme = kept;
  } catch {
    /* as above */
  }
  if (!readAddress()) choose({ dataset: summary.datasets[0] });
  else if (location.hash.includes("/")) $("pictures").scrollIntoView();
  setZoom(1, 0, 0);
}

opened = addressNow();

// For the browser's console, and for tests.
window.resultsPage = { data, state, choose, number, zoom, zoomAt, pictureOfView };
