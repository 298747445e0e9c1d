// Plots: figures that the page holds as JSON, drawn by Plotly, which is unpacked for the first. All that are not hidden
// are drawn at once, however far down, so that they are there when the page is printed; hidden ones when they appear.

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

// A colour of the style sheet as it is now, light or dark.
function inked(name) {
  const probe = h("span", { style: `color:var(${name});display:none` });
  document.body.append(probe);
  const colour = getComputedStyle(probe).color;
  probe.remove();
  return colour;
}

async function draw(place) {
  const text = place.previousElementSibling.textContent;
  const figure = JSON.parse(text, (key, value) => (String(value).startsWith("--") && key.endsWith("color") ? inked(value) : value));
  figure.layout.font.family = getComputedStyle(document.body).fontFamily;
  const modes = { displaylogo: false, responsive: true, modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]] };
  try {
    const Plotly = await plotly();
    await Plotly.react(place, figure.data, figure.layout, { ...modes, displayModeBar: innerWidth > 700 && "hover" });
  } catch (fault) {
    place.replaceChildren(h("p", { class: "note" }, `This browser cannot draw the plot (${fault.message}).`));
  }
}

const near = new IntersectionObserver(
  (entries) => {
    for (const { target, isIntersecting } of entries)
      if (isIntersecting) {
        near.unobserve(target);
        draw(target);
      }
  },
  { rootMargin: "999999px" },
);
const drawWhenSeen = () => $$(".plot").forEach((place) => near.observe(place));
