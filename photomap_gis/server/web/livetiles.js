// Tiles of a growing map: each is drawn until its successor is there, and only those that changed are asked for again.

const AT_ONCE = 4;
const REMEMBERED = 1500;
const RETRY_MS = 2000;

export class LiveTiles {
  /** options as of ol.source.TileImage; url(tileCoord) gives a tile's address. */
  constructor(map, options, url) {
    this.map = map;
    this.known = new Map();
    this.loading = new Set();
    this.source = new ol.source.TileImage({
      ...options, transition: 0, tileUrlFunction: url,
      tileLoadFunction: (tile, src) => this.first(tile, src),
    });
    map.on("moveend", () => this.pump());
  }

  key(tile) { return tile.getTileCoord().join("/"); }

  first(tile, src) {
    const entry = { tile, src, etag: "", stale: true };
    this.known.delete(this.key(tile));
    this.known.set(this.key(tile), entry);
    if (this.known.size > REMEMBERED) this.known.delete(this.known.keys().next().value);
    this.load(entry);
  }

  async load(entry) {
    if (this.loading.has(entry)) { entry.again = true; return; }
    this.loading.add(entry);
    entry.stale = false;
    try {
      // The browser asks with the ETag that it has: what did not change does not travel.
      const answer = await fetch(entry.src, { cache: "no-cache" });
      if (!answer.ok) throw new Error(answer.status);
      const etag = answer.headers.get("etag");
      if (etag !== entry.etag || !etag) {
        const picture = await createImageBitmap(await answer.blob());
        entry.etag = etag;
        this.show(entry, picture);
      }
    } catch {
      entry.stale = true;
      entry.notBefore = performance.now() + RETRY_MS;
      setTimeout(() => this.pump(), RETRY_MS + 50);
      if (!entry.etag) this.show(entry, blank());  // nothing yet: tried again when the server is back
    } finally {
      this.loading.delete(entry);
      if (entry.again) { entry.again = false; entry.stale = true; }
      this.pump();
    }
  }

  show(entry, picture) {
    entry.tile.setImage(picture);
    this.layer?.changed();
  }

  /** Everything within some boxes (of the map's projection) has changed; all of it without boxes. */
  change(extents) {
    const grid = this.source.getTileGrid();
    for (const entry of this.known.values()) {
      const box = grid.getTileCoordExtent(entry.tile.getTileCoord());
      if (!extents || extents.some(e => ol.extent.intersects(e, box))) entry.stale = true;
    }
    this.pump();
  }

  /** Ask again for what is stale and in sight, from the middle outwards. */
  pump() {
    const view = this.map.getView(), size = this.map.getSize();
    if (!this.layer?.getVisible() || !size || !view.getCenter()) return;
    const room = AT_ONCE - this.loading.size;
    if (room <= 0) return;
    const grid = this.source.getTileGrid();
    const zoom = grid.getZForResolution(view.getResolution(), this.source.zDirection);
    const sight = view.calculateExtent(size), [x, y] = view.getCenter();
    const away = e => {
      const c = ol.extent.getCenter(grid.getTileCoordExtent(e.tile.getTileCoord()));
      return Math.hypot(c[0] - x, c[1] - y);
    };
    [...this.known.values()]
      .filter(e => e.stale && !this.loading.has(e) && !(performance.now() < e.notBefore) && e.tile.getTileCoord()[0] === zoom
        && ol.extent.intersects(sight, grid.getTileCoordExtent(e.tile.getTileCoord())))
      .sort((a, b) => away(a) - away(b)).slice(0, room)
      .forEach(e => this.load(e));
  }
}

let nothing = null;
function blank() {
  nothing ??= Object.assign(document.createElement("canvas"), { width: 256, height: 256 });
  return nothing;
}
