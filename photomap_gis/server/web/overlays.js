// What lies over the map: footprints, track and finds up to a moment, and what is being measured.

import { areaM2, areaWords, lengthM, lengthWords, planeArea } from "./coordinates.js";

const stroke = (color, width, dash) => new ol.style.Stroke({ color, width, lineDash: dash });
const fill = color => new ol.style.Fill({ color });
const cased = (color, width) => [
  new ol.style.Style({ stroke: stroke("rgba(255,255,255,.85)", width + 2) }),
  new ol.style.Style({ stroke: stroke(color, width) }),
];

/** A vector layer of a GeoJSON address, read again by load(). */
export function geojsonLayer(view, style, zIndex) {
  const source = new ol.source.Vector();
  const layer = new ol.layer.Vector({ source, style, zIndex });
  layer.load = async url => {
    const answer = await fetch(url);
    if (!answer.ok) throw new Error(`${url}: ${answer.status}`);
    const options = view.georeferenced ? { dataProjection: "EPSG:4326", featureProjection: view.projection } : {};
    const features = new ol.format.GeoJSON().readFeatures(await answer.json(), options);
    source.clear();
    source.addFeatures(features.filter(f => f.getGeometry()));
    return features;
  };
  return layer;
}

/** Footprints of the frames up to state.moment, the newest of them marked; with footprints off only that one. */
export function footprintStyle(state) {
  const plain = new ol.style.Style({ stroke: stroke("rgba(11,92,173,.75)", 1.2), fill: fill("rgba(11,92,173,.04)") });
  const marked = [...cased("#d1495b", 2.5), new ol.style.Style({ fill: fill("rgba(209,73,91,.08)") })];
  return feature => {
    const order = feature.get("order");
    if (order > state.moment || !state.inPiece(feature)) return null;
    if (feature === state.picked) return marked;
    if (order === state.moment && state.moment < state.last) return marked;
    return state.footprints ? plain : null;
  };
}

/** The track up to state.moment: a line passes its frames' centres in the order of time. */
export function trackStyle(state) {
  const [case_, line] = cased("#e08a00", 2);
  return feature => {
    if (!state.inPiece(feature)) return null;
    const passed = feature.get("frames").filter(f => (state.orders.get(f) ?? 0) <= state.moment).length;
    const coordinates = feature.getGeometry().getCoordinates().slice(0, passed);
    if (!coordinates.length) return null;
    const geometry = new ol.geom.LineString(coordinates);
    const camera = new ol.style.Style({
      geometry: new ol.geom.Point(coordinates.at(-1)),
      image: new ol.style.Circle({ radius: 5, fill: fill("#e08a00"), stroke: stroke("#fff", 2) }),
    });
    return [...[case_, line].map(s => new ol.style.Style({ stroke: s.getStroke(), geometry })), camera];
  };
}

/** The colours of finds by kind. */
export const FIND_COLOURS = { intruder: "#d00000", victim: "#e07a00", hazard: "#b59b00", other: "#0b5cad" };

export function findStyle(feature) {
  return new ol.style.Style({
    image: new ol.style.Circle({ radius: 7, fill: fill(FIND_COLOURS[feature.get("kind")] ?? "#c1121f"), stroke: stroke("#fff", 2) }),
    text: new ol.style.Text({
      text: String(feature.get("name") ?? ""), offsetY: -16, font: "13px system-ui, sans-serif",
      fill: fill("#1b1f22"), stroke: stroke("#fff", 4),
    }),
  });
}

/** Lengths and areas drawn by hand; say(words) gets the result, also while drawing. */
export class Measuring {
  constructor(map, view, say) {
    Object.assign(this, { map, view, say, draw: null });
    this.source = new ol.source.Vector();
    const style = [...cased("#7b2cbf", 2.5), new ol.style.Style({
      fill: fill("rgba(123,44,191,.12)"),
      image: new ol.style.Circle({ radius: 4, fill: fill("#7b2cbf"), stroke: stroke("#fff", 1.5) }),
    })];
    this.style = style;
    map.addLayer(new ol.layer.Vector({ source: this.source, style, zIndex: 40 }));
  }

  /** Begin ("LineString" or "Polygon"), or end where kind is null. */
  use(kind) {
    if (this.draw) this.map.removeInteraction(this.draw);
    this.draw = null;
    if (!kind) return;
    this.draw = new ol.interaction.Draw({ source: this.source, type: kind, style: this.style });
    this.draw.on("drawstart", e => {
      this.source.clear();
      e.feature.getGeometry().on("change", g => this.say(this.words(g.target)));
    });
    this.draw.on("drawend", e => this.say(this.words(e.feature.getGeometry())));
    this.map.addInteraction(this.draw);
  }

  clear() {
    this.draw?.abortDrawing();
    this.source.clear();
    this.say("");
  }

  words(geometry) {
    const area = geometry.getType() === "Polygon";
    const line = area ? geometry.getCoordinates()[0] : geometry.getCoordinates();
    if (this.view.georeferenced) {
      const places = line.map(c => ol.proj.toLonLat(c));
      if (!area) return lengthWords(lengthM(places));
      return `${areaWords(areaM2(places))}, around ${lengthWords(lengthM(places))}`;
    }
    const length = line.slice(1).reduce((sum, c, i) => sum + Math.hypot(c[0] - line[i][0], c[1] - line[i][1]), 0);
    return area ? `${planeArea(line).toFixed(0)} square pixels` : `${length.toFixed(1)} pixels`;
  }
}
