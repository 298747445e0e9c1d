// The head of the page: who leads, in two sentences, and each lead in detail.

import { $, columnOf, data, h, summary, watch } from "./page.js";
import { copy, isKnown, number, titled } from "./words.js";

watch(["dataset"], () => {
  $("scores").hidden = $("cost").hidden = !data.columns.length;
  const scene = data.scene && data.scene !== data.name ? `: ${data.scene}` : "";
  $("title").textContent = summary.datasets.length > 1 ? data.name : `Results on ${data.name}${scene}`;
  const few = data.few ? [data.few] : [];
  $("verdicts").replaceChildren(...[...data.answer, ...few].map((line) => h("li", {}, ...withCommands(line))));
  const [sure, rest] = [true, false].map((is) => data.verdicts.filter((verdict) => isLead(verdict) === is));
  listed("leads", sure, sure.length === 1 ? "lead by more than chance" : "leads by more than chance");
  listed("chances", rest, rest.length === 1 ? "difference that may be chance" : "differences that may be chance");
  $("export-menu").replaceChildren(
    ...data.exports.map((one) =>
      h("button", { type: "button", click: (event) => copy(one.text, event.currentTarget) }, one.name),
    ),
  );
});

// A line whose commands stand between backticks.
const withCommands = (line) => line.split("`").map((part, n) => (n % 2 ? h("code", {}, part) : part));

// Verdicts that unfold below a heading, which says how many.
function listed(id, verdicts, what) {
  $(id).hidden = !verdicts.length;
  $(id).querySelector("summary").textContent = `${verdicts.length} ${what}`;
  $(id).querySelector("ul").replaceChildren(...verdicts.map(verdictLine));
}

// One view has no interval.
const isLead = (verdict) => !verdict.may_be_chance && isKnown(verdict.interval[0]);

// Who is ahead of whom in a score, by how much, and how steadily.
function verdictLine(verdict) {
  const column = columnOf(verdict.column);
  const [low, high] = verdict.interval;
  const parts = [
    `${verdict.leader} ${isLead(verdict) ? "leads" : "is ahead of"} ${verdict.second} by ${[number(verdict.difference), column.unit].filter(Boolean).join(" ")}`,
    isKnown(low) ? ` [${number(low)}, ${number(high)}]` : "",
    column.views > 1 ? `, best in ${Number(verdict.wins.toFixed(1))} of ${column.views} views` : ", on one view",
    isKnown(verdict.effect) ? `, effect ${verdict.effect.toFixed(1)}` : "",
  ];
  return h("li", {}, h("b", {}, titled(column)), parts.join(""));
}
