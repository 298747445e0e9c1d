// Beside the pictures: scores, water and command of the picture on the right.

import { $, columnOf, data, h, state, viewOf, watch } from "./page.js";
import { briefly, commandBox, commandFor, dot, number, percent, pictureName, titled } from "./words.js";
import { shownOf } from "./pictures.js";
import { waterLine } from "./water.js";

watch(["dataset", "view", "method", "before", "layer"], drawDetail);

function drawDetail() {
  const view = viewOf(state.view);
  if (!view) return;
  const at = data.methods.findIndex((m) => m.label === state.method);
  const shown = shownOf(view, state.method);
  if (at < 0) {
    $("detail").replaceChildren(h("h3", {}, pictureName(state.method)), fullLink(shown));
    $("again").replaceChildren();
    return;
  }
  const [method, result] = [data.methods[at], view.results[at]];
  const given = Object.entries(method.given)
    .map(([name, value]) => `${name} = ${JSON.stringify(value)}`)
    .join(", ");
  const parts = [h("h3", {}, dot(method.label), method.label), given ? h("p", { class: "note" }, given) : ""];
  if (result.status !== "ok")
    parts.push(
      h(
        "p",
        { class: result.status === "failed" ? "bad" : "" },
        `${result.status}${result.reason ? `: ${result.reason}` : ""}`,
      ),
    );
  else parts.push(...resultParts(result, shown));
  $("detail").replaceChildren(...parts);
  drawCommand();
}

// The command for this row: of the score that is looked at, or of all.
function drawCommand() {
  const [method, view] = [data.methods.find((m) => m.label === state.method), viewOf(state.view)];
  if (!method || !view) return;
  const [box, column] = [$("again"), columnOf(state.metric)];
  const only = box.dataset.only === "yes" && data.metric_words[state.metric];
  const pick = (value, text) =>
    h(
      "button",
      {
        type: "button",
        "aria-pressed": String(Boolean(only) === (value === "yes")),
        click: () => {
          box.dataset.only = value;
          drawCommand();
        },
      },
      text,
    );
  const choice =
    column && data.metric_words[state.metric]
      ? h(
          "span",
          { class: "choice", role: "group", "aria-label": "scores" },
          pick("no", "all scores"),
          pick("yes", titled(column)),
        )
      : "";
  box.replaceChildren(
    h("div", { class: "controls" }, h("h4", {}, "Run it again"), choice),
    commandBox(commandFor(method, view, only ? state.metric : "")),
  );
}
watch(["metric"], drawCommand);

function resultParts(result, shown) {
  const scores = data.columns.filter(
    (c) => (c.directed || c.cost) && c.key in result.scores && !state.unshown.has(c.key),
  );
  const line = (c) =>
    h(
      "div",
      { class: c.key === state.metric ? "chosen" : null },
      h("dt", {}, titled(c)),
      h(
        "dd",
        {},
        `${number(result.scores[c.key])} ${c.unit}`,
        result.covers[c.key] === undefined ? "" : h("small", {}, ` of ${percent(result.covers[c.key])}`),
      ),
    );
  const water = result.water && waterLine(result.water);
  const rest = Object.entries(result.record).map(([name, value]) =>
    h("div", {}, h("dt", {}, name.replaceAll("_", " ")), h("dd", {}, briefly(value))),
  );
  return [
    h("dl", { class: "scores" }, scores.map(line)),
    result.coverage < 1 ? h("p", { class: "note" }, `${percent(result.coverage)} of the pixels have a colour${shown.guesses ? "; fill=true guessed the others" : ""}.`) : "",
    state.layer === "confidence" && shown.about
      ? h(
          "p",
          { class: "note" },
          `The confidence that the method gives, from ${shown.about.low} (dark) to ${shown.about.high} (bright).`,
        )
      : "",
    water || "",
    fullLink(shown),
    rest.length ? h("details", {}, h("summary", {}, "The method's record"), h("dl", { class: "scores" }, rest)) : "",
  ];
}

const fullLink = (shown) =>
  shown.picture ? h("p", { class: "note" }, h("a", { href: shown.picture.link }, "The full picture")) : "";
