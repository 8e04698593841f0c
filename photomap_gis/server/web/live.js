// A flight under way: what the server tells of it, drawn over the map and said in words.

import { LiveView } from "./liveview.js";
import { droneStyle, ellipseRing, gapStyle, lineStyle } from "./liveoverlays.js";

const $ = id => document.getElementById(id);
const SILENT_S = 8;
const STILL_S = 4;
const COVERAGE_EVERY_MS = 3000;
const LEGENDS_EVERY_MS = 10000;
const SIGMAS_90 = 2.1460;  // of a round error: within so many sigmas lie 90 %

export class Live {
  constructor(page) {
    this.page = page;
    this.state = page.mission.live;
    this.fresh = new Set();
    this.source = new ol.source.Vector();
    this.line = new ol.source.Vector();
    this.ground = new ol.source.Vector();
    this.cursor = new ol.source.Vector();
    const layer = (source, style, zIndex) => {
      const made = new ol.layer.Vector({ source, style, zIndex, updateWhileAnimating: true, updateWhileInteracting: true });
      page.map.addLayer(made);
      return made;
    };
    this.groundLayer = layer(this.ground, gapStyle, 12);
    this.lineLayer = layer(this.line, lineStyle, 21);
    layer(this.source, droneStyle, 25);
    layer(this.cursor, droneStyle, 26);
    this.view = new LiveView(page);
    document.body.classList.add("is-live");
    for (const id of ["live", "show-coverage-row", "follow"]) $(id).hidden = false;
    $("show-frames").closest("label").hidden = true;
    this.heard = performance.now();
    this.listen();
    this.connect();
    this.loadTrack();
    this.loadCoverage();
    setInterval(() => this.tell(), 1000);
    setInterval(() => this.legends(), LEGENDS_EVERY_MS);
  }

  listen() {
    const { map } = this.page;
    $("show-track").addEventListener("change", e => this.lineLayer.setVisible(e.target.checked));
    $("show-coverage").addEventListener("change", e => {
      this.groundLayer.setVisible(e.target.checked);
      this.loadCoverage();
    });
    $("follow").addEventListener("click", () => this.follow(!this.following));
    map.on("pointerdrag", () => { this.moved = true; this.follow(false); });
    map.getView().on("change:resolution", () => { if (!this.fitting) this.moved = true; });
    map.on("pointermove", e => { if (!e.dragging && e.originalEvent.pointerType !== "touch") this.askAccuracy(e.coordinate); });
    map.on("singleclick", e => this.askAccuracy(e.coordinate));
    map.getTargetElement().addEventListener("pointerleave", () => this.cursor.clear());
    $("finish").addEventListener("click", () => this.finish());
    document.addEventListener("visibilitychange", () => { if (!document.hidden) this.changed(null); });
  }

  // What the server tells

  connect() {
    const events = this.events = new EventSource(this.page.mission.links.events);
    const on = (name, act) => events.addEventListener(name, e => { this.heard = performance.now(); act(JSON.parse(e.data)); });
    on("live", d => this.begun(d));
    on("alive", () => {});
    on("pose", d => this.pose(d));
    on("health", d => { this.state.health = d; this.tell(); });
    on("tiles", d => { this.state.version = d.version; this.changed(d.all ? null : d.areas); });
    on("solution", d => { this.say(solutionWords(d)); this.loadTrack(); });
    on("segment", d => { this.say(d.words); this.loadTrack(); });
    on("snapped", d => { sessionStorage.setItem("photomap-words", d.words); location.reload(); });
    on("find", () => this.page.marks.load());
    const ending = d => { this.state.end = d; this.state.phase = d.event; this.tell(); };
    on("finalising", ending);
    on("ended", ending);
    // Only where a server is still there: the page of one that has ended could not be loaded again.
    on("mission", async () => { if (await this.page.getOrNull(`missions/${this.page.mission.id}`)) location.reload(); });
    events.onerror = () => {
      this.lost = true;
      this.tell();
      if (events.readyState === EventSource.CLOSED) setTimeout(() => this.connect(), 2000);
    };
  }

  begun(d) {
    if (d.epoch !== this.page.mission.epoch || d.georeferenced !== this.page.georeferenced) return location.reload();
    const behind = this.lost || d.missed || d.version !== this.state.version;
    this.lost = false;
    this.state = d;
    if (behind) { this.changed(null); this.loadTrack(); this.page.marks.load(); }
    if (d.pose) this.pose(d.pose);
    this.tell();
  }

  /** Boxes of new ground (null: anywhere) to the layers, and what hangs on them. */
  changed(areas) {
    const extents = areas?.map(a => this.page.extentOfBounds(a));
    for (const raster of this.page.rasters.values()) raster.live?.change(extents);
    clearTimeout(this.coverageTimer);
    const wait = Math.max(200, COVERAGE_EVERY_MS - (performance.now() - (this.coverageAt ?? -1e9)));
    this.coverageTimer = setTimeout(() => this.loadCoverage(), wait);
    if (extents?.length) this.grow(extents);
  }

  /** Until somebody moves the map it shows all of it. */
  grow(extents) {
    this.extent ??= ol.extent.createEmpty();
    extents.forEach(e => ol.extent.extend(this.extent, e));
    if (this.moved || this.following) return;
    if (this.grown && this.page.shows(this.extent)) return;
    this.fitting = this.grown = true;
    this.page.fitExtent(ol.extent.buffer(this.extent, 0.15 * Math.max(ol.extent.getWidth(this.extent), ol.extent.getHeight(this.extent))));
    this.fitting = false;
  }

  pose(d) {
    if (d.frame !== this.state.pose?.frame || !this.posed) this.posed = performance.now();
    this.state.pose = d;
    if (this.state.phase === "starting") { this.state.phase = "flying"; this.tell(); }
    this.source.clear(true);
    const { page } = this, placed = d.centre !== null;
    const features = [];
    const add = (geometry, properties) => features.push(new ol.Feature({ geometry, ...properties }));
    if (d.footprint) add(new ol.geom.Polygon([[...d.footprint, d.footprint[0]].map(c => page.at(c))]), { role: "footprint" });
    if (d.drone) {
      const at = page.at(d.drone);
      if (placed && d.ellipse) add(ellipseRing(page, at, d.ellipse, SIGMAS_90), { role: "ellipse" });
      add(new ol.geom.Point(at), { role: "drone", heading: d.heading_deg, placed });
      if (this.following) this.keepInSight(at);
    }
    this.source.addFeatures(features);
    if (placed) this.goOn(page.at(d.centre), d.segment);
  }

  /** The track goes on between two looks at the whole of it. */
  goOn(at, segment) {
    const last = this.tail?.getCoordinates().at(-1);
    const far = this.page.map.getView().getResolution() * 3;
    if (last && this.tailSegment === segment && Math.hypot(at[0] - last[0], at[1] - last[1]) < far) return;
    if (!this.tail || this.tailSegment !== segment) {
      this.tail = new ol.geom.LineString([at, at]);
      this.tailSegment = segment;
      this.line.addFeature(new ol.Feature({ geometry: this.tail, role: "track" }));
    } else this.tail.appendCoordinate(at);
  }

  // What is asked for

  async loadTrack() {
    const pending = this.trackAsked = {};
    const document_ = await this.page.getOrNull(this.page.mission.links.track);
    if (!document_ || pending !== this.trackAsked) return;
    this.line.clear(true);
    this.tail = null;
    for (const f of document_.features) {
      const geometry = new ol.geom.LineString(f.geometry.coordinates.map(c => this.page.at(c)));
      this.line.addFeature(new ol.Feature({ geometry, role: "track" }));
      this.tail = geometry;
      this.tailSegment = f.properties.piece;
    }
  }

  async loadCoverage() {
    this.coverageAt = performance.now();
    const d = await this.page.getOrNull(this.page.mission.links.coverage);
    if (!d) return;
    this.coverage = d;
    const options = this.page.georeferenced ? { dataProjection: "EPSG:4326", featureProjection: this.page.projection } : {};
    const features = new ol.format.GeoJSON().readFeatures(d, options).filter(f => f.getGeometry());
    this.ground.clear(true);
    this.ground.addFeatures(features);
    if (features.length) this.grow([this.ground.getExtent()]);
    this.tell();
  }

  askAccuracy(coordinate) {
    this.asked = coordinate;
    if (this.asking) return;
    this.asking = setTimeout(async () => {
      const at = this.asked, [x, y] = this.page.place(at);
      const d = await this.page.getOrNull(`${this.page.mission.links.accuracy}?x=${x}&y=${y}`);
      this.asking = null;
      this.cursor.clear(true);
      const unit = this.page.georeferenced ? "m" : "px";
      $("accuracy-here").textContent = d?.ellipse
        ? `Map here ± ${d.ellipse.major.toFixed(2)} × ${d.ellipse.minor.toFixed(2)} ${unit} (1 sigma), 90 % within ${d.ellipse.ce90.toFixed(1)} ${unit}` : "";
      if (d?.ellipse) this.cursor.addFeature(new ol.Feature({ geometry: ellipseRing(this.page, at, d.ellipse, SIGMAS_90), role: "ellipse" }));
      if (at !== this.asked) this.askAccuracy(this.asked);
    }, 250);
  }

  /** Colours get another range as the flight goes on. */
  async legends() {
    if (document.hidden || this.lost || ![...this.page.rasters.values()].some(r => r.wanted && r.document.legend)) return;
    const fresh = await this.page.getOrNull(`missions/${this.page.mission.id}`);
    if (!fresh?.live || fresh.epoch !== this.page.mission.epoch) return;
    const changed = fresh.layers.some((l, i) => l.tiles !== this.page.mission.layers[i]?.tiles);
    this.page.mission.layers = fresh.layers;
    if (changed) this.page.makeRasters();
  }

  // What the operator does

  follow(on) {
    this.following = on;
    $("follow").setAttribute("aria-pressed", on);
    const { pose } = this.state;
    if (on && pose?.drone) this.page.map.getView().animate({ center: this.page.at(pose.drone), duration: 300 });
  }

  keepInSight(at) {
    const view = this.page.map.getView(), [w, h] = this.page.map.getSize();
    const [x, y] = this.page.map.getPixelFromCoordinate(at) ?? [w / 2, h / 2];
    if (Math.abs(x / w - 0.5) > 0.18 || Math.abs(y / h - 0.5) > 0.18)
      if (!view.getAnimating()) view.animate({ center: at, duration: 500 });
  }

  async finish() {
    const button = $("finish");
    if (button.dataset.sure !== "yes") {
      button.dataset.sure = "yes";
      button.textContent = "End the flight now? Press again";
      setTimeout(() => { button.dataset.sure = ""; button.textContent = "End flight"; }, 4000);
      return;
    }
    try {
      await this.page.send("POST", `missions/${this.page.mission.id}/live/finalise`, {});
    } catch (error) { this.say(error.message); }
  }

  // What is said

  say(words) { if (words) this.page.toast(words); }

  tell() {
    const { health, phase, end, pose } = this.state, silent = (performance.now() - this.heard) / 1000;
    const still = this.posed ? (performance.now() - this.posed) / 1000 : 0;
    const unit = this.page.georeferenced ? "m" : "px";
    let [level, head, words] = ["ok", "LIVE", ""];
    if (phase === "ended")  // the server of a flight that was not to stay ends with it: nothing is lost then
      [level, head, words] = ["ok", "LANDED", this.lost ? `the map is finished; 'photomap serve ${this.page.mission.name}' shows it` : end?.words ?? ""];
    else if (this.lost || silent > SILENT_S)
      [level, head, words] = ["bad", "SERVER LOST", `trying again; nothing heard for ${Math.round(silent)} s`];
    else if (phase === "finalising") [level, head, words] = ["wait", "FINISHING", `${Math.round(100 * (end?.progress ?? 0))} %: ${end?.words ?? ""}`];
    else if (phase === "starting") [level, head, words] = ["wait", "STARTING", "no picture yet"];
    else if (health?.link === "lost") [level, head, words] = ["bad", "VIDEO LOST", health.words[0] ?? "no pictures come"];
    else if (health?.link === "waiting" || (pose && !pose.centre)) [level, head, words] = ["wait", "MAP WAITS", health?.words[0] ?? "the ground is not recognised"];
    else if (still > STILL_S) [level, head, words] = ["wait", "NO NEW PICTURE", health?.words[0] ?? `for ${Math.round(still)} s`];
    else words = health?.words[0] ?? "";
    $("live-head").textContent = head;
    $("live").dataset.level = level;
    $("live-words").textContent = words;
    const chips = [];
    const chip = (text, level_) => chips.push([text, level_]);
    if (pose) chip(clock(pose.time_s), "plain");
    if (health) {
      chip(`${Math.round(health.fps)} fps`, health.fps >= 8 ? "ok" : health.fps >= 3 ? "wait" : "bad");
      chip(`${Math.round(health.latency_ms)} ms`, health.latency_ms <= 200 ? "ok" : health.latency_ms <= 1000 ? "wait" : "bad");
      chip({ none: "no GPS", searching: "GPS searching", ok: "GPS", lost: "GPS lost" }[health.gps], { ok: "ok", lost: "bad" }[health.gps] ?? "wait");
      if (health.dropped) chip(`${health.dropped} dropped`, health.dropped > 0.02 * health.frames ? "wait" : "plain");
      if (health.error_frames) chip(`${health.error_frames} bad frames`, "plain");
      if (health.segments > 1) chip(`${health.segments} pieces`, "wait");
    }
    if (pose?.ellipse) chip(`± ${pose.ellipse.ce90.toFixed(1)} ${unit}`, "plain");
    if (pose?.altitude_m != null) chip(`${Math.round(pose.altitude_m)} m up`, "plain");
    if (pose?.battery_percent != null) chip(`battery ${Math.round(pose.battery_percent)} %`, pose.battery_percent < 20 ? "bad" : pose.battery_percent < 35 ? "wait" : "plain");
    const { covered_m2: area, share } = this.coverage ?? {};
    if (share !== undefined) chip(`area ${Math.floor(100 * share)} % seen`, share > 0.995 ? "ok" : "plain");
    else if (area) chip(`${area < 1e4 ? `${Math.round(area)} m²` : `${(area / 1e4).toFixed(1)} ha`} seen`, "plain");
    $("chips").replaceChildren(...chips.map(([text, level_]) => Object.assign(document.createElement("span"), { textContent: text, className: `chip ${level_}` })));
    $("finish").hidden = !["starting", "flying"].includes(phase) && phase !== undefined;
  }
}

function clock(seconds) {
  const s = Math.floor(seconds), two = v => String(v).padStart(2, "0");
  return `${s >= 3600 ? `${Math.floor(s / 3600)}:` : ""}${two(Math.floor(s / 60) % 60)}:${two(s % 60)}`;
}

function solutionWords(d) {
  if (d.shift_px === null || d.shift_px < 1) return "";
  return `Map corrected: it moved by up to ${d.shift_m === null ? `${d.shift_px.toFixed(0)} pixels` : `${d.shift_m.toFixed(1)} m`}`;
}
