// What belongs to a raster on the page: its legend, its numbers in words, and the handle that swipes it.

const $ = id => document.getElementById(id);

export const timeWords = utc => utc?.replace("T", " ").replace(/\.000Z$|Z$/, " UTC") ?? "time unknown";

/** A layer's number in its units; seconds since 1970 are a time. */
export function valueWords(value, units, digits) {
  if (units.startsWith("s since 1970")) return timeWords(new Date(value * 1000).toISOString());
  return `${Number(value.toPrecision(digits))} ${units}`.trim();
}

/** A ramp of colours with the numbers at its ends; null where there is none. */
export function legendOf(words) {
  if (!words) return null;
  const legend = document.createElement("div"), bar = document.createElement("i");
  legend.className = "legend";
  bar.style.background = `linear-gradient(to right, ${words.colours.join(",")})`;
  legend.append(...[words.low, bar, words.high].map(v => (v === bar ? bar : valueWords(v, words.units, 3))));
  return legend;
}

/** The older picture lies on top, left of the handle only. */
export function swipe(page, raster) {
  const handle = $("swipe");
  raster.on("prerender", e => {
    const x = page.share * page.map.getSize()[0], [, height] = page.map.getSize();
    const corners = [[0, 0], [x, 0], [x, height], [0, height]].map(c => ol.render.getRenderPixel(e, c));
    e.context.save();
    e.context.beginPath();
    corners.forEach(([px, py], i) => (i ? e.context.lineTo(px, py) : e.context.moveTo(px, py)));
    e.context.closePath();
    e.context.clip();
  });
  raster.on("postrender", e => e.context.restore());
  if (page.share !== undefined) return;
  const set = share => {
    page.share = Math.max(0, Math.min(1, share));
    handle.style.left = `${page.share * 100}%`;
    handle.setAttribute("aria-valuenow", Math.round(page.share * 100));
    page.map.render();
  };
  handle.addEventListener("pointerdown", e => handle.setPointerCapture(e.pointerId));
  handle.addEventListener("pointermove", e => {
    if (handle.hasPointerCapture(e.pointerId)) set(e.clientX / innerWidth);
  });
  handle.addEventListener("keydown", e => {
    const step = { ArrowLeft: -0.02, ArrowRight: 0.02 }[e.key];
    if (step) { set(page.share + step); e.preventDefault(); }
  });
  set(0.5);
}
