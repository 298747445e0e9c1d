// Beside the pictures: scores, water and command of the picture on the right, and which views to look at.

const MOST_LOSSES = 6;
const SYMBOLS = { B: "B", beta: "β", gamma: "γ" };

function drawDetail() {
  const view = viewNow();
  if (!view) return;
  const shown = shownOf(view, state.method);
  const method = data.methods[placeOf(state.method)];
  const full = shown.picture ? h("p", { class: "note" }, h("a", { href: shown.picture.link }, "The full picture")) : null;
  const command = method?.command && [method.command, view.words, data.metrics].filter(Boolean).join(" ");
  $("again").replaceChildren(...(command ? [h("h4", {}, "Run it again"), h("code", { class: "command" }, command)] : []));
  if (!method) return $("detail").replaceChildren(h("h3", {}, pictureName(state.method)), full || "");
  const result = view.results[placeOf(state.method)];
  const given = Object.entries(method.given).map(([name, value]) => `${name} = ${JSON.stringify(value)}`).join(", "); // prettier-ignore
  const reason = `${result.status}${result.reason ? `: ${result.reason}` : ""}`;
  $("detail").replaceChildren(
    h("h3", {}, dot(method.label), method.label),
    ...(given ? [h("p", { class: "note" }, given)] : []),
    ...(result.status === "ok" ? resultParts(result, shown) : [h("p", { class: result.status === "failed" ? "bad" : "" }, reason)]),
    ...(full ? [full] : []),
  );
}

function resultParts(result, shown) {
  const scores = data.columns.filter((c) => c.directed && c.key in result.scores);
  const lines = scores.map((c) => {
    const covered = result.covers[c.key];
    const of = covered === undefined ? null : h("small", {}, ` of ${percent(covered)}`);
    const value = h("dd", {}, `${number(result.scores[c.key])} ${c.unit}`, of);
    return h("div", { class: c.key === state.metric ? "chosen" : "" }, h("dt", {}, titled(c)), value);
  });
  const notes = [...result.limits]; // what the method does not know of this view
  const guessed = shown.guesses ? "; fill=true guessed the others" : "";
  if (result.coverage < 1) notes.push(`${percent(result.coverage)} of the pixels have a colour${guessed}.`);
  if (state.layer === "confidence" && shown.about)
    notes.push(`The confidence that the method gives, from ${shown.about.low} (dark) to ${shown.about.high} (bright).`);
  const record = Object.entries(result.record).map(([name, value]) =>
    h("div", {}, h("dt", {}, name.replaceAll("_", " ")), h("dd", {}, briefly(value))),
  );
  return [
    h("dl", { class: "scores" }, lines, result.water ? waterLines(result.water) : null),
    ...notes.map((note) => h("p", { class: "note" }, note)),
    ...(record.length ? [h("details", {}, h("summary", {}, "The method's record"), h("dl", { class: "scores" }, record))] : []),
  ];
}

function waterLines(water) {
  const known = Object.keys(SYMBOLS).filter((key) => water[key]?.some((x) => x !== null));
  return known.map((key) => {
    const rgb = key === "B" ? water.B.map((x) => Math.round(255 * Math.min(1, Math.max(0, x)))) : null;
    const light = rgb && h("i", { class: "light", style: `background: rgb(${rgb.join(" ")})`, title: "the veiling light" });
    return h("div", {}, h("dt", {}, SYMBOLS[key], light), h("dd", {}, water[key].map(number).join("  ")));
  });
}

// -- which view to look at: the best, median and worst, and those on which the right picture loses most ----

const placed = (ranked, place) => ranked[Math.min(ranked.length - 1, Math.floor(place * ranked.length))];

function drawRankedViews() {
  const ranked = viewsByScore(state.method, state.metric);
  const column = columnOf(state.metric);
  $("ranked-views").hidden = !ranked.length || !column?.ranked;
  if ($("ranked-views").hidden) return;
  for (const button of $$("[data-place]")) {
    const [view, score] = placed(ranked, button.dataset.place);
    button.title = `${view.name}: ${titled(column)} ${number(score)} ${column.unit}`;
    button.ariaPressed = String(view.name === state.view);
  }
}
for (const button of $$("[data-place]"))
  button.addEventListener("click", () =>
    choose({ view: placed(viewsByScore(state.method, state.metric), button.dataset.place)[0].name }),
  );

function drawLosses() {
  const [column, [left, right]] = [columnOf(state.metric), [state.before, state.method]];
  const scoresOf = (which) => viewsByScore(which === VIEW ? photograph()[0] : which, state.metric);
  const other = new Map(scoresOf(left));
  const sign = column?.better === "lower" ? 1 : -1;
  const found = scoresOf(right)
    .filter(([view]) => other.has(view))
    .map(([view, score]) => [view, sign * (score - other.get(view))])
    .sort((a, b) => b[1] - a[1]);
  $("losses").hidden = found.length < 2 || left === right || !column?.ranked;
  if ($("losses").hidden) return;
  const lost = found.filter(([, loss]) => loss > 0);
  const won = found.filter(([, loss]) => loss < 0);
  $("losses-title").textContent = lost.length
    ? `Largest loss of ${pictureName(right)} against ${pictureName(left)}`
    : `${pictureName(right)} loses on no view against ${pictureName(left)}; its smallest gains`;
  const line = ([view, loss]) => {
    const gap = `${loss > 0 ? "−" : "+"}${number(Math.abs(loss))} ${column.unit}`.trim();
    const open = { type: "button", class: "plain", "data-view": view.name, "aria-current": String(view.name === state.view) };
    return h("li", {}, h("button", open, h("span", {}, view.name), h("b", {}, gap)));
  };
  $("losses-list").replaceChildren(...(lost.length ? lost : found).slice(0, MOST_LOSSES).map(line));
  $("losses-note").textContent = `${titled(column)}, better on ${won.length} of ${found.length} views`;
}
