// Finds: marked by a click or a key, listed, told in words, taken along to other programs.

import { FIND_COLOURS } from "./overlays.js";

const $ = id => document.getElementById(id);
const KEYS = { 1: "intruder", 2: "victim", 3: "hazard", 4: "other" };
const capital = word => word[0].toUpperCase() + word.slice(1);

export class Finds {
  constructor(page) {
    this.page = page;
    this.last = "other";
    this.armed = null;
    this.over = null;
    $("mark").replaceChildren(...Object.entries(KEYS).map(([key, kind]) => {
      const button = Object.assign(document.createElement("button"), { type: "button", title: `Mark: key ${key} at the cursor, or press and then click the place` });
      button.dataset.kind = kind;
      const dot = document.createElement("i");
      dot.style.background = FIND_COLOURS[kind];
      button.append(dot, capital(kind));
      button.addEventListener("click", () => this.arm(this.armed === kind ? null : kind));
      return button;
    }));
    const exports_ = ["geojson", "kml", "gpx", "cot"].filter(f => f === "geojson" || page.georeferenced);
    $("find-exports").replaceChildren(...exports_.map(f => Object.assign(document.createElement("a"), {
      href: `missions/${page.mission.id}/finds.${f}`, download: `finds.${f}`, textContent: { geojson: "GeoJSON", kml: "KML", gpx: "GPX", cot: "CoT" }[f],
    })));
    this.listen();
  }

  listen() {
    const { map } = this.page, picture = $("view-picture");
    map.on("pointermove", e => { this.over = e.dragging ? this.over : { map: e.coordinate }; });
    map.getTargetElement().addEventListener("pointerleave", () => { this.over = null; });
    picture.addEventListener("pointermove", e => { this.over = { view: this.page.live?.view.placeAt(e) }; });
    picture.addEventListener("pointerleave", () => { this.over = null; });
    picture.addEventListener("click", e => {
      const place = this.page.live?.view.placeAt(e);
      if (this.armed && place) this.mark(this.armed, place);
    });
    $("arm-away").addEventListener("click", () => this.arm(null));
    $("mark-open").addEventListener("click", () => this.arm(this.armed ? null : this.last));
    addEventListener("keydown", e => {
      if (e.ctrlKey || e.metaKey || e.altKey || e.repeat || /^(INPUT|TEXTAREA|SELECT)$/.test(e.target.tagName) && e.target.type !== "checkbox" && e.target.type !== "range") return;
      if (e.key === "Escape") return this.arm(null);
      const kind = e.key.toLowerCase() === "f" ? this.last : KEYS[e.key];
      const place = kind && this.placeOfKey();
      if (!kind) return;
      if (place) this.mark(kind, place);
      else this.arm(kind);
    });
  }

  /** Where a key marks: at the cursor, else the middle of the newest picture. */
  placeOfKey() {
    if (this.over?.view) return this.over.view;
    if (this.over?.map) return this.page.place(this.over.map);
    return this.page.live?.state.pose?.centre ?? null;
  }

  /** The next click on the map marks; null: no more. */
  arm(kind) {
    this.armed = kind;
    document.body.classList.toggle("armed", Boolean(kind));
    $("arm").hidden = !kind;
    $("arm-words").textContent = kind ? `${capital(kind)}: press where it is` : "";
    for (const b of $("mark").children) b.setAttribute("aria-pressed", b.dataset.kind === kind);
    for (const b of $("arm-kinds").children) b.setAttribute("aria-pressed", b.dataset.kind === kind);
    if (kind && !$("arm-kinds").children.length)
      $("arm-kinds").replaceChildren(...[...$("mark").children].map(b => {
        const copy = b.cloneNode(true);
        copy.addEventListener("click", () => this.arm(copy.dataset.kind));
        copy.setAttribute("aria-pressed", copy.dataset.kind === kind);
        return copy;
      }));
    if (kind) this.page.menu(false);
  }

  /** Take a click where one was awaited; whether it was. */
  take(coordinate) {
    if (!this.armed) return false;
    this.mark(this.armed, this.page.place(coordinate));
    return true;
  }

  async mark(kind, place) {
    this.last = kind;
    this.arm(null);
    try {
      const find = await this.page.send("POST", `missions/${this.page.mission.id}/finds`, { kind, place });
      await this.load();
      const sure = find.ce90_m === null ? "" : `, within ${find.ce90_m.toFixed(1)} m (90 %)`;
      this.page.toast(`${find.name} marked${sure}`);
      this.pick(find.id);
    } catch (error) { this.page.toast(`Not marked: ${error.message}`); }
  }

  async load() {
    const features = await this.page.finds.load(this.page.mission.links.finds);
    $("finds-row").hidden = !features.length;
    $("finds-count").textContent = `(${features.length})`;
    this.list(features);
    return features;
  }

  list(features) {
    const held = document.activeElement?.closest?.("#find-list li")?.dataset.id;
    const ours = features.filter(f => f.get("id") && f.get("kind"));
    const rows = new Map([...$("find-list").children].map(row => [row.dataset.id, row]));
    $("find-exports").hidden = !ours.length;
    $("find-list").replaceChildren(...ours.reverse().map(f => {
      const old = rows.get(f.get("id"));
      return old && held === f.get("id") ? old : this.row(f);  // a note that is being written stays
    }));
    if (held) $("find-list").querySelector(`[data-id="${CSS.escape(held)}"] input`)?.focus();
  }

  row(f) {
    const id = f.get("id"), root = `missions/${this.page.mission.id}/finds/${encodeURIComponent(id)}`;
    const row = document.createElement("li");
    row.dataset.id = id;
    const go = Object.assign(document.createElement("button"), { type: "button", className: "go", title: "Show on the map" });
    const dot = document.createElement("i");
    dot.style.background = FIND_COLOURS[f.get("kind")] ?? "#555";
    const ce90 = f.get("ce90_m"), words = document.createElement("span");
    words.textContent = `${f.get("name")}${ce90 == null ? "" : ` ± ${ce90.toFixed(1)} m`}`;
    const time = document.createElement("small");
    time.textContent = f.get("time_utc")?.slice(11, 19) ?? "";
    go.append(dot, words, time);
    go.addEventListener("click", () => this.fly(f));
    const away = Object.assign(document.createElement("button"), { type: "button", className: "away", textContent: "×", ariaLabel: `Remove ${f.get("name")}`, title: "Remove (press twice)" });
    away.addEventListener("click", () => {
      if (away.dataset.sure) return this.change("DELETE", root);
      away.dataset.sure = "yes";
      away.textContent = "Sure?";
      setTimeout(() => { away.dataset.sure = ""; away.textContent = "×"; }, 3000);
    });
    const note = Object.assign(document.createElement("input"), { type: "text", maxLength: 2000, placeholder: "Note", value: f.get("note") ?? "", ariaLabel: `Note on ${f.get("name")}` });
    note.addEventListener("change", () => this.change("PATCH", root, { note: note.value }));
    note.addEventListener("keydown", e => { if (e.key === "Enter") note.blur(); });
    const head = document.createElement("div");
    head.append(go, away);
    row.append(head);
    if (f.get("snapshot")) {
      const picture = Object.assign(document.createElement("img"), { src: `${root}.jpg`, loading: "lazy", alt: `Picture of ${f.get("name")}` });
      picture.addEventListener("click", () => picture.classList.toggle("large"));
      row.append(picture);
    }
    row.append(note);
    return row;
  }

  fly(f) {
    if (!f.getGeometry()) return this.page.toast("This find has no place on the map");
    this.page.live?.follow(false);
    if (this.page.live) this.page.live.moved = true;
    const view = this.page.map.getView();
    view.animate({ center: f.getGeometry().getCoordinates(), resolution: Math.min(view.getResolution(), view.getMinResolution() * 12), duration: 400 });
    this.page.menu(false);
  }

  pick(id) {
    for (const row of $("find-list").children) row.classList.toggle("fresh", row.dataset.id === id);
  }

  async change(method, url, body) {
    try {
      await this.page.send(method, url, body);
      document.activeElement?.blur?.();
      await this.load();
    } catch (error) { this.page.toast(error.message); }
  }
}
