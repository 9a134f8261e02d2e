// Shapes of a track in longitude and latitude. Used by the map page and by session files, which hold a copy of this file.

const METRES_PER_DEGREE = 111320;
/** Square root of the 95 % quantile of chi-square with two degrees of freedom: from 1 sigma to 95 %. */
const TO_95 = 2.4477;

/** A longitude within 180 degrees of another one: lines over the antimeridian are to go the short way. */
export const beside = (lon, other) => lon + 360 * Math.round((other - lon) / 360);

/** Whether a position may be used. */
export const usable = (point) => ["tracking", "coasting"].includes(point?.state);

/** The 95 % ellipse of a position as a closed ring of longitude and latitude. */
export function ellipse(point) {
  const [ee, en, nn] = point.covariance_en_m2;
  const mean = (ee + nn) / 2;
  const spread = Math.hypot((ee - nn) / 2, en);
  const [long, short] = [mean + spread, Math.max(mean - spread, 0)].map((variance) => TO_95 * Math.sqrt(variance));
  const turn = Math.atan2(2 * en, ee - nn) / 2;
  const ring = [];
  for (let i = 0; i <= 48; i++) {
    const angle = (i / 48) * 2 * Math.PI;
    const [along, across] = [long * Math.cos(angle), short * Math.sin(angle)];
    const east = along * Math.cos(turn) - across * Math.sin(turn);
    const north = along * Math.sin(turn) + across * Math.cos(turn);
    ring.push([
      point.lon_deg + east / (METRES_PER_DEGREE * Math.cos((point.lat_deg * Math.PI) / 180)),
      point.lat_deg + north / METRES_PER_DEGREE,
    ]);
  }
  return ring;
}

/** Least seconds that are taken for a date: those of 2001 since 1970. */
const DATES_FROM_S = 1e9;

/** A frame of a track in words. */
export function frameText({ number, time_s, point }) {
  const where = point?.lat_deg === undefined ? "" : `, ${point.lat_deg.toFixed(6)}, ${point.lon_deg.toFixed(6)}, within ${point.radius95_m.toFixed(1)} m`;
  const time = time_s >= DATES_FROM_S ? new Date(1000 * time_s).toISOString() : `${time_s} s`;
  return `${point?.state ?? "no position"} at frame ${number} (${time})${where}`;
}
