// How a flight is drawn over its map.

const stroke = (color, width, lineDash) => new ol.style.Stroke({ color, width, lineDash });
const fill = color => new ol.style.Fill({ color });
const two = (color, width, lineDash) => [
  new ol.style.Style({ stroke: stroke("rgba(255,255,255,.9)", width + 2) }),
  new ol.style.Style({ stroke: stroke(color, width, lineDash) }),
];

/** An error ellipse of so many sigmas about a point of the map. */
export function ellipseRing(page, at, e, sigmas) {
  const unit = page.unitsPerMetre(at), turn = e.bearing_deg * Math.PI / 180;
  const [a, b] = [e.major, e.minor].map(v => v * sigmas * unit);
  const ring = [...Array(49).keys()].map(i => {
    const t = i / 24 * Math.PI, u = a * Math.cos(t), v = b * Math.sin(t);
    return [at[0] + u * Math.sin(turn) + v * Math.cos(turn), at[1] + u * Math.cos(turn) - v * Math.sin(turn)];
  });
  return new ol.geom.Polygon([ring]);
}

const FOOTPRINT = [...two("#d1495b", 2.5), new ol.style.Style({ fill: fill("rgba(209,73,91,.08)") })];
const ELLIPSE = [...two("#7b2cbf", 1.5, [5, 3]), new ol.style.Style({ fill: fill("rgba(123,44,191,.14)") })];

// A quadcopter's arrow, its nose up; drawn once for each state.
const arrow = colour => `data:image/svg+xml,${encodeURIComponent(
  `<svg xmlns="http://www.w3.org/2000/svg" width="40" height="40" viewBox="-20 -20 40 40"><path d="M0-17 12 14 0 7-12 14Z"
  fill="${colour}" stroke="#fff" stroke-width="2.5" stroke-linejoin="round"/></svg>`)}`;
const ARROWS = { true: arrow("#0b5cad"), false: arrow("#8a8f94") };
const DRONES = {};

export function droneStyle(feature) {
  const role = feature.get("role");
  if (role === "footprint") return FOOTPRINT;
  if (role === "ellipse") return ELLIPSE;
  const placed = String(Boolean(feature.get("placed")));
  const heading = feature.get("heading");
  DRONES[placed] ??= new ol.style.Icon({ src: ARROWS[placed], width: 34, height: 34, rotateWithView: true });
  DRONES[placed].setRotation((heading ?? 0) * Math.PI / 180);
  return new ol.style.Style({ image: DRONES[placed], zIndex: 2 });
}

const TRACK = two("#e08a00", 2);
export function lineStyle() { return TRACK; }

let hatching = null;
function hatch() {
  if (hatching) return hatching;
  const canvas = Object.assign(document.createElement("canvas"), { width: 10, height: 10 }), c = canvas.getContext("2d");
  c.strokeStyle = "rgba(193,18,31,.75)";
  c.lineWidth = 1.5;
  c.beginPath();
  for (const d of [-10, 0, 10]) { c.moveTo(d, 10); c.lineTo(d + 10, 0); }
  c.stroke();
  return hatching = c.createPattern(canvas, "repeat");
}

export function gapStyle(feature) {
  const kind = feature.get("kind");
  if (kind === "gaps") return new ol.style.Style({ fill: fill(hatch()), stroke: stroke("rgba(193,18,31,.9)", 1.5) });
  if (kind === "area") return two("#1b1f22", 2, [8, 5]);
  return new ol.style.Style({ stroke: stroke("rgba(255,255,255,.7)", 1) });
}
