// The stabilised view: the newest picture lying still in the map's frame; asked for only while it can be seen.

const $ = id => document.getElementById(id);
const PAUSE_MS = { desktop: 40, phone: 200 };

export class LiveView {
  constructor(page) {
    this.page = page;
    this.canvas = $("view-picture");
    this.sequence = -1;
    this.open = localStorage.getItem("photomap-view") !== "closed" && !navigator.connection?.saveData;
    $("view-toggle").addEventListener("click", () => this.show(!this.open));
    document.addEventListener("visibilitychange", () => this.run());
    setInterval(() => this.age(), 1000);
    $("view").hidden = false;
    this.show(this.open);
  }

  show(open) {
    this.open = open;
    localStorage.setItem("photomap-view", open ? "open" : "closed");
    $("view").classList.toggle("closed", !open);
    $("view-toggle").textContent = open ? "Hide" : "Video";
    $("view-toggle").setAttribute("aria-expanded", open);
    this.run();
  }

  async run() {
    if (this.running) return;
    this.running = true;
    while (this.open && !document.hidden) {
      const began = performance.now();
      try {
        const answer = await fetch(`${this.page.mission.links.view}?after=${this.sequence}`, { cache: "no-store" });
        if (answer.status === 200) await this.draw(answer);
        else if (!answer.ok) await pause(2000);
      } catch { await pause(2000); }
      const phone = innerWidth <= 760;
      await pause(Math.max(0, PAUSE_MS[phone ? "phone" : "desktop"] - (performance.now() - began)));
    }
    this.running = false;
  }

  async draw(answer) {
    const words = JSON.parse(answer.headers.get("photomap-view"));
    const picture = await createImageBitmap(await answer.blob());
    if (words.sequence < this.sequence - 1000) this.sequence = -1;  // another session
    this.sequence = words.sequence;
    this.corners = words.corners;
    this.drawn = performance.now();
    if (this.old) this.age();
    if (this.canvas.width !== picture.width || this.canvas.height !== picture.height)
      Object.assign(this.canvas, { width: picture.width, height: picture.height });
    this.canvas.getContext("2d").drawImage(picture, 0, 0);
    picture.close();
    this.canvas.dataset.sequence = words.sequence;
  }

  /** A picture that stands still because none comes must not look like one of now. */
  age() {
    const seconds = Math.round((performance.now() - (this.drawn ?? performance.now())) / 1000);
    this.old = seconds >= 3;
    $("view").classList.toggle("old", this.old);
    $("view-words").textContent = this.old ? `Still: ${seconds} s old` : "Stabilised video";
  }

  /** The place (of the documents' coordinates) under a mouse event, null beside the picture. */
  placeAt(event) {
    const box = this.canvas.getBoundingClientRect();
    const u = (event.clientX - box.left) / box.width, v = (event.clientY - box.top) / box.height;
    if (!this.corners || !(u >= 0 && u <= 1 && v >= 0 && v <= 1)) return null;
    const [nw, ne, se, sw] = this.corners;
    return [0, 1].map(i => (1 - v) * ((1 - u) * nw[i] + u * ne[i]) + v * ((1 - u) * sw[i] + u * se[i]));
  }
}

const pause = ms => new Promise(done => setTimeout(done, ms));
