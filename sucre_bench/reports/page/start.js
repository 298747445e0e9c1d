// The page's keys and lists, light and dark, and the start.

// A list shows one of several parts, and hides the others.
for (const select of $$("[data-shows]"))
  select.addEventListener("change", () => {
    for (const option of select.options) $(option.value).hidden = !option.selected;
  });
$("dataset")?.addEventListener("change", (event) => choose({ dataset: Number(event.currentTarget.value) }));

// What names a view or method shows its pictures; with Alt, on the left.
addEventListener("click", (event) => {
  const named = event.target.closest("[data-view], [data-method], [data-opens]");
  if (!named) return;
  const { view, method, opens } = named.dataset;
  if (opens) choose({ dataset: Number(opens) });
  else choose({ ...(view ? { view } : {}), ...(method ? { [event.altKey ? "before" : "method"]: method } : {}) });
});

// -- light and dark ----------------------------------------------------------------------------------------

const darkBrowser = matchMedia("(prefers-color-scheme: dark)");
function switchTheme() {
  const theme = document.documentElement.dataset.theme || (darkBrowser.matches ? "dark" : "light");
  document.documentElement.dataset.theme = theme === "dark" ? "light" : "dark";
  drawWhenSeen();
}
$("theme").addEventListener("click", switchTheme);
darkBrowser.addEventListener("change", drawWhenSeen);

// -- keys --------------------------------------------------------------------------------------------------

const keys = {
  "/": () => $("filter").focus(),
  "?": () => $("keys").togglePopover(),
  "[": () => step(-1),
  "]": () => step(1),
  x: swap,
  f: () => $("guesses-pick").hidden || $("guesses").click(),
  d: switchTheme,
  "+": () => zoomAt(1.5),
  "=": () => zoomAt(1.5),
  "-": () => zoomAt(1 / 1.5),
  0: () => setZoom(1, 0, 0),
};
addEventListener("keydown", (event) => {
  if (event.key === "Escape" && event.target === $("filter")) {
    $("filter").value = "";
    $("filter").dispatchEvent(new Event("input"));
    $("filter").blur();
  }
  const isTyping = event.target.closest("input:not([type=checkbox]), select");
  if (isTyping || event.ctrlKey || event.metaKey || !data) return;
  const digit = /^Digit([1-9])$/.exec(event.code);
  const method = digit && data.methods[digit[1] - 1];
  const act = keys[event.key] || (method && (() => choose({ [event.altKey ? "before" : "method"]: method.label })));
  if (!act) return;
  event.preventDefault();
  act();
});

// -- the address: dataset/view/right/left/score ------------------------------------------------------------

function keepAddress() {
  const parts = [data.name, state.view, state.method, state.before, state.metric];
  history.replaceState(null, "", `#${parts.map(encodeURIComponent).join("/")}`);
}

function readAddress() {
  let parts = [];
  try {
    parts = location.hash.slice(1).split("/").map(decodeURIComponent);
  } catch {
    /* no address of this page */
  }
  const [name, view, method, before, metric] = parts;
  if (parts.length < 2 || !summary.datasets.includes(name)) return false;
  choose({ dataset: summary.datasets.indexOf(name), view, method, before, metric });
  $("pictures").scrollIntoView();
  return true;
}
addEventListener("hashchange", readAddress);

if (datasets.length && !readAddress()) choose({ dataset: 0 });
setZoom(1, 0, 0);
drawWhenSeen();

// For the browser's console, and for tests.
window.resultsPage = { get data() { return data; }, state, choose, number, zoom, zoomAt }; // prettier-ignore
