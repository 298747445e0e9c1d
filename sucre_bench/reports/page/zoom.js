// Zoom and pan, one for the slider and all pictures of the grid: three numbers that the style sheet reads.

const MOST_ZOOM = 32;
const zoom = { scale: 1, x: 0, y: 0 }; // x, y: where the picture's corner is, in widths and heights of the frame

// Whether a thumbnail shows too little.
const isNear = () => zoom.scale > 1.2;

function setZoom(scale, x, y) {
  zoom.scale = Math.min(MOST_ZOOM, Math.max(1, scale));
  zoom.x = Math.min(0, Math.max(1 - zoom.scale, x));
  zoom.y = Math.min(0, Math.max(1 - zoom.scale, y));
  const section = $("pictures");
  for (const key of ["scale", "x", "y"]) section.style.setProperty(`--${key}`, zoom[key]);
  section.classList.toggle("near", zoom.scale > 1);
  section.classList.toggle("pixels", zoom.scale >= 6);
  $("scale").textContent = `${zoom.scale < 10 ? Number(zoom.scale.toFixed(1)) : Math.round(zoom.scale)}×`;
  if (isNear()) sharpen();
}

// Zoom about a point of the frame, in its widths and heights.
function zoomAt(factor, px = 0.5, py = 0.5) {
  const scale = Math.min(MOST_ZOOM, Math.max(1, zoom.scale * factor));
  const grown = scale / zoom.scale;
  setZoom(scale, px - (px - zoom.x) * grown, py - (py - zoom.y) * grown);
}

// Let a frame be zoomed and panned by pointer. slide(share): where the frame has a divider to be dragged.
function zoomable(frame, slide = null) {
  const pointers = new Map();
  let mode = "";
  let travelled = 0;
  const place = (event) => {
    const box = frame.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  };
  frame.addEventListener("pointerdown", (event) => {
    if (event.button) return;
    pointers.set(event.pointerId, place(event));
    travelled = 0;
    mode =
      pointers.size > 1 ? "pinch" : slide && (zoom.scale === 1 || event.target.closest(".divider")) ? "slide" : "pan";
    if (mode === "slide") slide(place(event)[0]);
    if (slide) frame.setPointerCapture(event.pointerId);
  });
  frame.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const now = place(event);
    if (mode === "pinch") {
      const [other] = [...pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
      if (other)
        zoomAt(
          apart(now, other) / Math.max(apart(before, other), 1e-3),
          (now[0] + other[0]) / 2,
          (now[1] + other[1]) / 2,
        );
    } else if (mode === "slide") slide(now[0]);
    else setZoom(zoom.scale, zoom.x + now[0] - before[0], zoom.y + now[1] - before[1]);
    travelled += Math.hypot(now[0] - before[0], now[1] - before[1]);
    pointers.set(event.pointerId, now);
  });
  for (const end of ["pointerup", "pointercancel", "pointerleave"])
    frame.addEventListener(end, (event) => pointers.delete(event.pointerId));
  frame.addEventListener(
    "click",
    (event) => {
      // the end of a drag is no click
      if (travelled > 0.02) {
        event.preventDefault();
        event.stopImmediatePropagation();
      }
    },
    true,
  );
  frame.addEventListener("dblclick", (event) => zoomAt(zoom.scale > 8 ? 0 : 2.5, ...place(event)));
  frame.addEventListener(
    "wheel",
    (event) => {
      // a plain wheel scrolls the page, as everywhere
      if (!event.ctrlKey && !event.metaKey) return;
      event.preventDefault();
      zoomAt(Math.exp(-event.deltaY / (event.deltaMode ? 10 : 250)), ...place(event));
    },
    { passive: false },
  );
}

const apart = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);

$("nearer").addEventListener("click", () => zoomAt(1.5));
$("farther").addEventListener("click", () => zoomAt(1 / 1.5));
$("whole").addEventListener("click", () => setZoom(1, 0, 0));
