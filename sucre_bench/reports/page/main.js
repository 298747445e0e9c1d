// The entry of the page: its links, keys, light and dark, and the start.

import { $, choose, data, h, state, summary, watch } from "./page.js";
import { briefly, commandBox, commandFor, dot, number } from "./words.js";
import "./sortable_table.js";
import "./verdicts.js";
import "./scores.js";
import { setZoom, zoom, zoomAt } from "./zoom.js";
import { step, swap } from "./pictures.js";
import "./detail.js";
import "./grid.js";
import "./ranked_views.js";
import "./panels.js";
import { pictureOfView } from "./downloads.js";
import "./charts.js";
import { isDark } from "./plots.js";
import "./cost.js";
import "./distances.js";
import "./water.js";
import "./sweep.js";
import { keepAddress, readAddress } from "./address.js";

// -- links ----------------------------------------------------------------------------------------------------------

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

keepAddress();

// For the browser's console, and for tests.
window.resultsPage = { data, state, choose, number, zoom, zoomAt, pictureOfView };
