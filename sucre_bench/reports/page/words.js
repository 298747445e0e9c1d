// Numbers and commands as people read them.

const HUGE = 1e307;
const ARROWS = { higher: "↑", lower: "↓", none: "" };

// Three figures, two below 0.1, as the tables of the command line have them.
function number(value) {
  if (value === null || value === undefined) return "–";
  const size = Math.abs(value);
  if (size >= HUGE) return value > 0 ? "∞" : "−∞";
  const text =
    size >= 100
      ? value.toFixed(0)
      : size >= 10
        ? value.toFixed(1)
        : size >= 1
          ? value.toFixed(2)
          : size >= 0.1
            ? value.toFixed(3)
            : size >= 0.0001
              ? value.toPrecision(2)
              : size
                ? value.toExponential(1)
                : "0";
  return text.replace("-", "−");
}

const isFinite_ = (value) => value !== null && value !== undefined && Math.abs(value) < HUGE;
const percent = (share) => `${share > 0.999 && share < 1 ? "99.9" : Math.round(share * 100)} %`;

// A score's name, with its variant where a metric has several here.
function titled(column) {
  const several = data.columns.filter((c) => c.metric === column.metric).length > 1;
  return several ? `${column.metric} (${column.variant})` : column.metric;
}

const withUnit = (column) => [titled(column), ARROWS[column.better], column.unit].filter(Boolean).join(" ");

function pictureName(which) {
  return which === VIEW ? "the view" : which === REFERENCE ? "reference, without water" : which;
}

// A method's colour before its name.
const dot = (label_) => h("i", { class: "dot", style: `--own:var(--m${summary.methods.indexOf(label_)})` });

// The command that makes a restoration again, or all of a method's, with one score or all of them.
function commandFor(method, view, metric = "") {
  if (!method.command) return "";
  return [method.command, view ? view.words : method.views, data.metric_words[metric]].filter(Boolean).join(" ");
}

function commandBox(command) {
  if (!command)
    return h(
      "p",
      { class: "note" },
      "These rows are of a version that did not keep the dataset's options: the command cannot be told.",
    );
  return h(
    "div",
    { class: "command" },
    h("code", {}, command),
    h(
      "button",
      { type: "button", "aria-label": "copy the command", click: (event) => copy(command, event.currentTarget) },
      "Copy",
    ),
  );
}

// Pages opened from disk may not use the clipboard everywhere: then the old way.
async function copy(text, button) {
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    const area = h("textarea", { class: "unseen" });
    area.value = text;
    document.body.append(area);
    area.select();
    document.execCommand("copy");
    area.remove();
  }
  const before = button.textContent;
  button.textContent = "Copied";
  $("said").textContent = "copied";
  setTimeout(() => {
    button.textContent = before;
  }, 1200);
}
