// The page of `photomap serve`: a mission's layers, what lies over them, and where the cursor is.

import { lengthM, placeWords } from "./coordinates.js";
import { Finds } from "./finds.js";
import { Live } from "./live.js";
import { legendOf, swipe, timeWords, valueWords } from "./layers.js";
import { LiveTiles } from "./livetiles.js";
import { Measuring, findStyle, footprintStyle, geojsonLayer, trackStyle } from "./overlays.js";

const $ = id => document.getElementById(id);
const get = async url => {
  const answer = await fetch(url);
  const document_ = await answer.json();
  if (!answer.ok) throw new Error(document_.message ?? answer.statusText);
  return document_;
};

class Page {
  constructor(mission) {
    this.mission = mission;
    this.georeferenced = mission.georeferenced;
    const extent = mission.layers.reduce((sum, l) => ol.extent.extend(sum, [...l.scheme.bounds]), ol.extent.createEmpty());
    this.projection = this.georeferenced ? ol.proj.get("EPSG:3857")
      : new ol.proj.Projection({ code: "local", units: "pixels", extent });
    this.state = {
      moment: 0, last: 0, orders: new Map(), footprints: false, picked: null,
      piece: this.georeferenced ? null : mission.pieces[0] ?? null,
      inPiece: f => this.state.piece === null || f.get("piece") === null || f.get("piece") === this.state.piece,
    };
    const finest = this.resolution(mission.layers[0]);
    this.map = new ol.Map({
      target: "map",
      controls: [new ol.control.Zoom()],
      view: new ol.View({
        projection: this.projection, enableRotation: false, minResolution: finest / 8, constrainResolution: false,
        showFullExtent: true,
        ...(this.georeferenced ? {} : { maxResolution: finest * 64 }),
      }),
    });
    this.frames = geojsonLayer(this, footprintStyle(this.state), 20);
    this.track = geojsonLayer(this, trackStyle(this.state), 21);
    this.finds = geojsonLayer(this, findStyle, 30);
    [this.frames, this.track, this.finds].forEach(l => this.map.addLayer(l));
    this.measuring = new Measuring(this.map, this, words => { $("measured").textContent = words; });
    this.rasters = new Map();
    this.tell();
    this.makeRasters();
    this.fit();
    this.marks = new Finds(this);
    this.live = mission.live ? new Live(this) : null;
    this.listen();
  }

  /** A place of the documents as the map has it, and back. */
  at(place) { return this.georeferenced ? ol.proj.fromLonLat(place) : place; }
  place(coordinate) { return this.georeferenced ? ol.proj.toLonLat(coordinate) : coordinate; }

  /** How long a metre (of a map without a place: one of its units) is there in the map's projection. */
  unitsPerMetre(at) {
    return this.georeferenced ? 1 / Math.cos(ol.proj.toLonLat(at)[1] * Math.PI / 180) : 1;
  }

  extentOfBounds(bounds) {
    return this.georeferenced ? ol.proj.transformExtent(bounds, "EPSG:4326", this.projection) : bounds;
  }

  toast(words) {
    $("toast").textContent = words;
    $("toast").hidden = !words;
    clearTimeout(this.toasting);
    this.toasting = setTimeout(() => { $("toast").hidden = true; }, 6000);
  }

  async getOrNull(url) {
    try { return await get(url); } catch { return null; }
  }

  async send(method, url, body) {
    const json = body === undefined ? {} : { headers: { "content-type": "application/json" }, body: JSON.stringify(body) };
    const answer = await fetch(url, { method, ...json });
    if (!answer.ok) throw new Error((await answer.json().catch(() => null))?.message ?? answer.statusText);
    return answer.status === 204 ? null : answer.json();
  }

  resolution(layer) {
    return this.georeferenced ? 2 * Math.PI * 6378137 / 256 / 2 ** layer.scheme.max_zoom : layer.scheme.unit_per_px;
  }

  extentOf(layer) { return this.extentOfBounds(layer.scheme.bounds); }

  /** A layer's tiles: of a finished map as they are, of one that grows as they become (and wherever it grows to). */
  sourceOf(layer) {
    const { scheme } = layer, levels = [...Array(scheme.max_zoom + 1).keys()];
    const size = this.resolution(layer), growing = Boolean(this.mission.live);
    const url = ([z, x, y]) => layer.tiles.replace("{z}", z).replace("{x}", x).replace("{y}", y);
    const options = {
      projection: this.projection,
      tileGrid: new ol.tilegrid.TileGrid({
        origin: scheme.origin_xy, resolutions: levels.map(z => size * 2 ** (scheme.max_zoom - z)),
        tileSize: scheme.tile_px, minZoom: Math.min(scheme.min_zoom, scheme.max_zoom),
        ...(growing ? {} : { extent: this.extentOf(layer) }),
      }),
      interpolate: true, wrapX: this.georeferenced,
    };
    return growing ? new LiveTiles(this.map, options, url) : { source: new ol.source.TileImage({ ...options, tileUrlFunction: url }) };
  }

  tell() {
    const m = this.mission;
    document.title = `${m.name} - photomap`;
    $("name").textContent = m.name;
    $("note").textContent = m.note;
    $("note").hidden = !m.note;
    $("accuracy").replaceChildren(...m.accuracy_words.filter(w => w !== m.note).map(w => {
      const item = document.createElement("li");
      item.textContent = w;
      return item;
    }));
    $("warnings").textContent = m.warnings.join("\n");
  }

  makeRasters() {
    for (const raster of this.rasters.values()) this.map.removeLayer(raster);
    const shown = new Map([...this.rasters].map(([id, r]) => [id, { visible: r.wanted, opacity: r.getOpacity() }]));
    this.rasters.clear();
    const order = { map: 1, layer: 2, before: 3 };
    const rows = this.mission.layers.map(layer => {
      const tiles = this.sourceOf(layer);
      const raster = new ol.layer.Tile({ source: tiles.source, zIndex: order[layer.role] });
      if (tiles instanceof LiveTiles) { tiles.layer = raster; raster.live = tiles; }
      const old = shown.get(layer.id);
      raster.document = layer;
      raster.wanted = old?.visible ?? layer.role !== "layer";
      raster.setOpacity(old?.opacity ?? 1);
      this.rasters.set(layer.id, raster);
      this.map.addLayer(raster);
      if (layer.role === "before") swipe(this, raster);
      return this.row(raster);
    });
    $("layers").replaceChildren(...rows);
    this.showPiece();
    $("swipe").hidden = ![...this.rasters.values()].some(r => r.document.role === "before" && r.wanted);
  }

  row(raster) {
    const row = document.createElement("div"), label = document.createElement("label");
    const box = Object.assign(document.createElement("input"), { type: "checkbox", checked: raster.wanted });
    box.id = `show-${raster.document.id}`;
    label.append(box, ` ${raster.document.title}`);
    const opacity = Object.assign(document.createElement("input"), {
      type: "range", min: 0, max: 1, step: 0.05, value: raster.getOpacity(), ariaLabel: `Opacity of ${raster.document.title}`,
    });
    opacity.hidden = !raster.wanted;
    opacity.addEventListener("input", () => raster.setOpacity(Number(opacity.value)));
    raster.row = row;
    row.append(label);
    const legend = legendOf(raster.document.legend);
    if (legend) { row.append(legend); legend.hidden = !raster.wanted; }
    row.append(opacity);
    box.addEventListener("change", () => {
      raster.wanted = box.checked;
      opacity.hidden = !box.checked;
      if (legend) legend.hidden = !box.checked;
      if (box.checked) this.live?.legends();
      if (raster.document.role === "before") $("swipe").hidden = !box.checked;
      this.showPiece();
    });
    return row;
  }

  showPiece() {
    const { piece } = this.state;
    for (const r of this.rasters.values()) {
      const here = piece === null || r.document.piece === null || r.document.piece === piece;
      r.setVisible(r.wanted && here);
      r.row.hidden = !here;
    }
    for (const l of [this.frames, this.track]) l.changed();
    const maps = this.mission.layers.filter(l => l.role === "map");
    $("pieces").hidden = piece === null || maps.length < 2;
    if (!$("piece").options.length)
      maps.forEach(l => $("piece").add(new Option(l.title, l.piece)));
  }

  async loadOverlays() {
    const { links } = this.mission;
    if (this.live) return this.marks.load();
    const [frames] = await Promise.all([this.frames.load(links.frames), this.track.load(links.track), this.marks.load()]);
    const { state } = this, wasLast = state.moment >= state.last;
    this.byOrder = frames.sort((a, b) => a.get("order") - b.get("order"));
    state.orders = new Map(frames.map(f => [f.get("frame"), f.get("order")]));
    state.last = Math.max(0, frames.length - 1);
    state.picked = null;
    $("moment").max = state.last;
    $("time").hidden = frames.length < 2;
    this.setMoment(wasLast ? state.last : Math.min(state.moment, state.last));
  }

  setMoment(order) {
    this.state.moment = order;
    $("moment").value = order;
    const frame = this.byOrder[order];
    $("moment-words").textContent = frame
      ? `Frame ${order + 1} of ${this.byOrder.length}: ${frame.get("name")}, ${timeWords(frame.get("time_utc"))}${frame.getGeometry() ? "" : `, ${frame.get("status")}`}` : "";
    $("moment").setAttribute("aria-valuetext", $("moment-words").textContent);
    this.frames.changed();
    this.track.changed();
  }

  fit() {
    const first = this.mission.layers.find(l => this.state.piece === null || l.piece === this.state.piece);
    this.fitExtent(this.live?.extent ?? this.extentOf(first ?? this.mission.layers[0]));
  }

  fitExtent(extent) {
    this.map.getView().fit(extent, { padding: this.padding() });
  }

  /** What panels cover of the window: above, right, below, left. */
  padding() {
    const phone = innerWidth <= 760, video = !phone && this.live && !$("view").classList.contains("closed");
    return [$("title").offsetHeight + 20, phone ? 10 : 270, phone ? 170 : 80, video ? 350 : phone ? 10 : 20];
  }

  /** Whether an extent can be seen, beside the panels. */
  shows(extent) {
    const [w, h] = this.map.getSize(), [top, right, bottom, left] = this.padding();
    const [a, b] = [ol.extent.getTopLeft(extent), ol.extent.getBottomRight(extent)].map(c => this.map.getPixelFromCoordinate(c));
    return Boolean(a && b) && a[0] >= left && a[1] >= top && b[0] <= w - right && b[1] <= h - bottom;
  }

  listen() {
    this.map.on("pointermove", e => { if (!e.dragging) this.say(e.coordinate); });
    this.map.on("moveend", () => this.scale());
    this.map.on("click", e => { if (this.marks.take(e.coordinate)) this.taken = e.originalEvent.timeStamp; });
    this.map.on("singleclick", e => {
      if (!this.measuring.draw && this.taken !== e.originalEvent.timeStamp) this.pick(e);
    });
    $("show-track").addEventListener("change", e => this.track.setVisible(e.target.checked));
    $("show-finds").addEventListener("change", e => this.finds.setVisible(e.target.checked));
    $("show-frames").addEventListener("change", e => this.footprints(e.target.checked));
    $("moment").addEventListener("input", e => {
      if (!this.touched) { this.touched = true; this.footprints(true); }
      this.setMoment(Number(e.target.value));
    });
    $("piece").addEventListener("change", e => {
      this.state.piece = Number(e.target.value);
      this.showPiece();
      this.fit();
    });
    $("fit").addEventListener("click", () => this.fit());
    $("menu").addEventListener("click", () => this.menu(!$("side").classList.contains("open")));
    const tools = { length: "LineString", area: "Polygon" };
    const use = tool => {
      for (const id of Object.keys(tools)) $(id).setAttribute("aria-pressed", id === tool);
      this.measuring.use(tool ? tools[tool] : null);
      if (tool) $("measured").textContent = tool === "length" ? "Tap points; twice on the last ends" : "Tap corners; twice on the last ends";
    };
    for (const id of Object.keys(tools))
      $(id).addEventListener("click", () => {
        this.measuring.clear();
        use($(id).getAttribute("aria-pressed") === "true" ? null : id);
        this.menu(false);
      });
    $("clear").addEventListener("click", () => { use(null); this.measuring.clear(); $("picked").textContent = ""; this.mark(null); });
    addEventListener("keydown", e => { if (e.key === "Escape") $("clear").click(); });
  }

  menu(open) {
    $("side").classList.toggle("open", open);
    $("menu").setAttribute("aria-expanded", open);
    $("menu").textContent = open ? "Close" : "Layers";
  }

  footprints(on) {
    this.state.footprints = $("show-frames").checked = on;
    this.frames.changed();
  }

  mark(feature) {
    this.state.picked = feature;
    this.frames.changed();
  }

  say(coordinate) {
    if (!this.georeferenced) {
      $("coordinates").textContent = `${coordinate[0].toFixed(1)}, ${coordinate[1].toFixed(1)} (x right, y up; pixels of the first frame)`;
      return;
    }
    const [lon, lat] = ol.proj.toLonLat(coordinate);
    $("coordinates").textContent = placeWords(lon, lat);
  }

  /** A round length, measured on the ellipsoid in the middle of the window. */
  scale() {
    const [x, y] = this.map.getView().getCenter(), side = 50 * this.map.getView().getResolution();
    const ends = [[x - side, y], [x + side, y]];
    const per100 = this.georeferenced ? lengthM(ends.map(c => ol.proj.toLonLat(c))) : 2 * side;
    const power = 10 ** Math.floor(Math.log10(per100)), round = [5, 2, 1].find(k => k * power <= per100) * power;
    const unit = this.georeferenced ? "m" : "px";
    $("scale-words").textContent = unit === "m" && round >= 1000 ? `${round / 1000} km`
      : unit === "m" && round < 1 ? `${Math.round(round * 100)} cm` : `${round} ${unit}`;
    $("scale").lastElementChild.style.width = `${100 * round / per100}px`;
  }

  async pick(event) {
    this.say(event.coordinate);
    const lines = [];
    const find = this.map.forEachFeatureAtPixel(event.pixel, f => f, { layerFilter: l => l === this.finds, hitTolerance: 6 });
    if (find) {
      const { geometry, ...rest } = find.getProperties();
      lines.push("Find", ...Object.entries(rest).filter(([, v]) => v !== null && typeof v !== "object").map(([k, v]) => `${k}: ${v}`));
    }
    const frame = this.nearestFrame(event.coordinate);
    this.mark(frame);
    if (frame) {
      const p = frame.getProperties();
      lines.push(`Seen best by ${p.name}`, timeWords(p.time_utc));
      if (p.sigma !== null && this.georeferenced) lines.push(`position ± ${p.sigma.toFixed(2)} m (1 sigma, predicted)`);
    }
    lines.push(...await this.values(event.coordinate));
    $("picked").textContent = lines.filter(Boolean).join("\n");
  }

  /** Of the frames up to the moment that saw a place, the one whose centre is nearest. */
  nearestFrame(coordinate) {
    const seen = this.frames.getSource().getFeaturesAtCoordinate(coordinate)
      .filter(f => f.get("order") <= this.state.moment && this.state.inPiece(f));
    const away = f => {
      const c = ol.extent.getCenter(f.getGeometry().getExtent());
      return Math.hypot(c[0] - coordinate[0], c[1] - coordinate[1]);
    };
    return seen.sort((a, b) => away(a) - away(b))[0] ?? null;
  }

  async values(coordinate) {
    const [x, y] = this.georeferenced ? ol.proj.toLonLat(coordinate) : coordinate;
    const asked = [...this.rasters.values()].filter(r => r.getVisible() && r.document.legend);
    return Promise.all(asked.map(async r => {
      const id = encodeURIComponent(r.document.id);
      const answer = await get(`missions/${this.mission.id}/layers/${id}/value?x=${x}&y=${y}`);
      return answer.value === null ? "" : `${r.document.title}: ${valueWords(answer.value, answer.units, 5)}`;
    }));
  }

  async refresh() {
    this.mission = await get(`missions/${this.mission.id}`);
    if (this.mission.georeferenced !== this.georeferenced) return location.reload();
    this.tell();
    // A find that was marked changes no picture: what is drawn stays.
    const drawn = [...this.rasters.values()].map(r => r.document.tiles);
    if (String(drawn) !== String(this.mission.layers.map(l => l.tiles))) this.makeRasters();
    await this.loadOverlays();
  }
}

async function start() {
  const { missions } = await get("missions");
  const page = new Page(missions[0]);
  await page.loadOverlays();
  if (!page.live) {  // a flight has a stream of its own, and a browser only so many connections
    const events = new EventSource("events");
    events.addEventListener("mission", e => {
      const { mission, epoch } = JSON.parse(e.data);
      if (mission === page.mission.id && epoch !== page.mission.epoch) page.refresh().catch(fail);
    });
  }
  page.toast(sessionStorage.getItem("photomap-words") ?? "");
  sessionStorage.removeItem("photomap-words");
  window.photomap = page;  // for tests and for the curious
  document.body.dataset.ready = "yes";
}

function fail(error) {
  $("note").textContent = `This map cannot be shown: ${error.message}`;
  $("note").hidden = false;
}

start().catch(fail);
