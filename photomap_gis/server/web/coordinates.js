// Places in words: latitude and longitude, UTM and MGRS on WGS84, and true lengths and areas.
// Transverse Mercator by Krüger's series (C. F. F. Karney, "Transverse Mercator with an accuracy of a few nanometers",
// 2011, eqs. 7-9 and 35) to the 4th order: better than a millimetre within a zone. MGRS: NGA.STND.0037.

const A = 6378137, F = 1 / 298.257223563, N = F / (2 - F), E = Math.sqrt(F * (2 - F));
const RECTIFYING_M = A / (1 + N) * (1 + N ** 2 / 4 + N ** 4 / 64);
const ALPHA = [
  N / 2 - 2 * N ** 2 / 3 + 5 * N ** 3 / 16 + 41 * N ** 4 / 180,
  13 * N ** 2 / 48 - 3 * N ** 3 / 5 + 557 * N ** 4 / 1440,
  61 * N ** 3 / 240 - 103 * N ** 4 / 140,
  49561 * N ** 4 / 161280,
];
const RAD = Math.PI / 180;
const BANDS = "CDEFGHJKLMNPQRSTUVWX", ROWS = "ABCDEFGHJKLMNPQRSTUV";
const COLUMNS = ["STUVWXYZ", "ABCDEFGH", "JKLMNPQR"];

/** Easting and northing in metres of a transverse Mercator projection of scale 1 about a central meridian. */
export function transverseMercator(lonDeg, latDeg, centralDeg) {
  const lam = wrap(lonDeg - centralDeg) * RAD, s = Math.sin(latDeg * RAD);
  const t = Math.sinh(Math.atanh(s) - E * Math.atanh(E * s));
  const xi = Math.atan2(t, Math.cos(lam)), eta = Math.asinh(Math.sin(lam) / Math.hypot(t, Math.cos(lam)));
  let x = eta, y = xi;
  ALPHA.forEach((a, i) => {
    const k = 2 * (i + 1);
    x += a * Math.cos(k * xi) * Math.sinh(k * eta);
    y += a * Math.sin(k * xi) * Math.cosh(k * eta);
  });
  return [RECTIFYING_M * x, RECTIFYING_M * y];
}

/** UTM: {zone, band, easting, northing}, or null beyond 80 degrees south and 84 north. */
export function utm(lonDeg, latDeg) {
  if (!(latDeg >= -80 && latDeg <= 84)) return null;
  const lon = wrap(lonDeg), band = BANDS[Math.min(19, Math.floor((latDeg + 80) / 8))];
  let zone = Math.floor((lon + 180) / 6) % 60 + 1;
  if (band === "V" && lon >= 3 && lon < 12) zone = 32;
  if (band === "X" && lon >= 0 && lon < 42) zone = lon < 9 ? 31 : lon < 21 ? 33 : lon < 33 ? 35 : 37;
  const [x, y] = transverseMercator(lon, latDeg, zone * 6 - 183);
  return { zone, band, easting: 500000 + 0.9996 * x, northing: (latDeg < 0 ? 1e7 : 0) + 0.9996 * y };
}

/** MGRS to the metre ("32U MV 12345 67890"), or "" where UTM has no place. */
export function mgrs(lonDeg, latDeg) {
  const u = utm(lonDeg, latDeg);
  if (!u) return "";
  const e = Math.floor(u.easting), n = Math.floor(u.northing);  // MGRS names the square that holds the point
  const column = COLUMNS[u.zone % 3][Math.floor(e / 1e5) - 1];
  const row = ROWS[(Math.floor(n / 1e5) + (u.zone % 2 ? 0 : 5)) % 20];
  const digits = v => String(v % 1e5).padStart(5, "0");
  return `${String(u.zone).padStart(2, "0")}${u.band} ${column}${row} ${digits(e)} ${digits(n)}`;
}

/** Length in metres of a line of [lon, lat]; each part is measured about its own meridian. */
export function lengthM(lonLats) {
  let sum = 0;
  for (let i = 1; i < lonLats.length; i++) {
    const [a, b] = [lonLats[i - 1], lonLats[i]], middle = a[0] + wrap(b[0] - a[0]) / 2;
    const [p, q] = [a, b].map(c => transverseMercator(c[0], c[1], middle));
    sum += Math.hypot(p[0] - q[0], p[1] - q[1]);
  }
  return sum;
}

/** Area in square metres of a ring of [lon, lat], on a plane about its middle meridian. */
export function areaM2(ring) {
  const first = ring[0][0], lons = ring.map(c => wrap(c[0] - first));
  const middle = first + (Math.min(...lons) + Math.max(...lons)) / 2;
  return planeArea(ring.map(c => transverseMercator(c[0], c[1], middle)));
}

/** Area of a ring of [x, y]. */
export function planeArea(ring) {
  const [ox, oy] = ring[0];  // small numbers: northings of millions would cost digits
  let twice = 0;
  ring.forEach(([x, y], i) => {
    const [u, v] = ring[(i + 1) % ring.length];
    twice += (x - ox) * (v - oy) - (u - ox) * (y - oy);
  });
  return Math.abs(twice) / 2;
}

/** A place as people read it, a line a system. */
export function placeWords(lonDeg, latDeg) {
  const u = utm(lonDeg, latDeg), lines = [`${latDeg.toFixed(6)}, ${wrap(lonDeg).toFixed(6)} (lat, lon)`];
  if (u) lines.push(`UTM ${u.zone}${u.band} ${u.easting.toFixed(1)} ${u.northing.toFixed(1)}`, `MGRS ${mgrs(lonDeg, latDeg)}`);
  return lines.join("\n");
}

export function lengthWords(m) {
  return m < 1000 ? `${m.toFixed(m < 100 ? 2 : 1)} m` : `${(m / 1000).toFixed(3)} km`;
}

export function areaWords(m2) {
  return m2 < 1e4 ? `${m2.toFixed(1)} m²` : m2 < 1e6 ? `${(m2 / 1e4).toFixed(3)} ha` : `${(m2 / 1e6).toFixed(3)} km²`;
}

function wrap(lonDeg) {
  return lonDeg >= -180 && lonDeg < 180 ? lonDeg : ((lonDeg + 180) % 360 + 360) % 360 - 180;
}
