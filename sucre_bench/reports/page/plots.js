// Plots, drawn by Plotly, which is unpacked when the first of them comes into view.

import { $, h, shownMethods, summary, watch } from "./page.js";

let unpacking = null;

function plotly() {
  unpacking ??= (async () => {
    const bytes = Uint8Array.from(atob($("plotly").textContent), (letter) => letter.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    const script = await new Response(stream).text();
    // The styles of its maps, which we do not draw, are not in the page's policy: it takes them for loaded.
    const maps = /getElementById\("([0-9a-f]{64})"\)/.exec(script);
    if (maps) document.head.append(h("meta", { id: maps[1] }));
    styleByScript();
    document.head.append(h("script", {}, script));
    return window.Plotly;
  })();
  return unpacking;
}

// The page's policy allows styles that a script sets, and none as attributes: Plotly sets some so.
function styleByScript() {
  const { setAttribute } = Element.prototype;
  Element.prototype.setAttribute = function (name, value) {
    if (name === "style") this.style.cssText = value;
    else setAttribute.call(this, name, value);
  };
}

const pending = new Map();
const seen = new IntersectionObserver(
  (entries) => {
    for (const { target, isIntersecting } of entries) if (isIntersecting) paint(target);
  },
  { rootMargin: "300px" },
);

// A printer waits for no plot, so the browser draws those out of view, too, when it has time.
const whenIdle = window.requestIdleCallback || ((act) => setTimeout(act, 1000));

// Plot when the place is in view, or nothing else is to do: make() -> {traces, layout}, or null where there is nothing to draw.
export function plot(id, make) {
  const place = $(id);
  pending.set(place, make);
  seen.unobserve(place);
  seen.observe(place);
  whenIdle(() => paint(place));
}

async function paint(place) {
  const make = pending.get(place);
  if (!make) return;
  pending.delete(place);
  const made = make();
  const part = place.closest("[id$=-part]") || place;
  part.hidden = !made;
  if (!made) return;
  try {
    const Plotly = await plotly();
    await Plotly.react(
      place,
      made.traces,
      {
        ...paper(),
        ...made.layout,
        xaxis: { ...axis(), ...made.layout.xaxis },
        yaxis: { ...axis(), ...made.layout.yaxis },
      },
      {
        displaylogo: false,
        responsive: true,
        displayModeBar: !isNarrow(),
        modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]],
      },
    );
  } catch (fault) {
    place.replaceChildren(h("p", { class: "note" }, `This browser cannot draw the plot (${fault.message}).`));
  }
}

export const inked = (name) => {
  const probe = h("span", { style: `color:var(--${name});display:none` });
  document.body.append(probe);
  const colour = getComputedStyle(probe).color;
  probe.remove();
  return colour;
};
export const isDark = () =>
  getComputedStyle(document.documentElement).colorScheme.includes("dark") &&
  (document.documentElement.dataset.theme === "dark" ||
    (!document.documentElement.dataset.theme && matchMedia("(prefers-color-scheme: dark)").matches));

function paper() {
  return {
    paper_bgcolor: "transparent",
    plot_bgcolor: "transparent",
    font: { family: getComputedStyle(document.body).fontFamily, size: 12.5, color: inked("ink") },
    margin: { l: 58, r: 16, t: 14, b: 56 + legendHeight(shownMethods().map((m) => m.label)) },
    hovermode: "closest",
    legend: legendBelow(),
    colorway: [inked("ink")],
    modebar: { bgcolor: "transparent", color: inked("dim"), activecolor: inked("accent") },
    hoverlabel: { bgcolor: inked("raised"), bordercolor: inked("line"), font: { color: inked("ink") } },
  };
}

// A legend at the bottom, and about how much of the height it takes.
export const legendBelow = () => ({
  orientation: "h",
  yref: "container",
  y: 0,
  yanchor: "bottom",
  x: 0,
  xref: "container",
  xanchor: "left",
});
export const legendHeight = (names) =>
  22 * Math.ceil(names.reduce((width, name) => width + 55 + 7.5 * name.length, 0) / (Math.min(innerWidth, 1400) - 60));
export const isNarrow = () => innerWidth < 700;

export function axis() {
  return {
    gridcolor: inked("line"),
    zeroline: false,
    linecolor: inked("line"),
    ticks: "outside",
    ticklen: 4,
    tickcolor: inked("line"),
    automargin: true,
    title: { standoff: 8 },
  };
}

watch(["dataset", "theme"], () =>
  summary.methods.forEach((own, at) => document.documentElement.style.setProperty(`--m${at}`, ownColour(own))),
);

// A method's colour, lifted where it would not be seen on dark.
export function ownColour(label) {
  const hex = summary.colours[label] || "#888888";
  const rgb = [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
  const light = (0.299 * rgb[0] + 0.587 * rgb[1] + 0.114 * rgb[2]) / 255;
  if (!isDark() || light > 0.3) return hex;
  return `rgb(${rgb.map((x) => Math.round(x + (255 - x) * 0.6)).join(",")})`;
}

const SIGNS = ["circle", "square", "diamond", "triangle-up", "cross", "x", "star", "hexagon"];
export const signOf = (label) => SIGNS[summary.methods.indexOf(label) % SIGNS.length];

// Plotly reads some markup in text: a label stays a label.
export const label = (text) => text.replaceAll("&", "&amp;").replaceAll("<", "&lt;");
