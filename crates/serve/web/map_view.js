// The map: tiles of the service, and answers on top of them. Nothing else is loaded.
import * as maplibregl from "/web/maplibre-gl.mjs";
import { beside } from "/web/track_shapes.js";

const METRES_PER_DEGREE = 111320;

/** A closed ring of longitude and latitude around a point. */
function circle(lon, lat, radiusM) {
  const ring = [];
  for (let i = 0; i <= 64; i++) {
    const angle = (i / 64) * 2 * Math.PI;
    ring.push([
      lon + (radiusM * Math.sin(angle)) / (METRES_PER_DEGREE * Math.cos((lat * Math.PI) / 180)),
      lat + (radiusM * Math.cos(angle)) / METRES_PER_DEGREE,
    ]);
  }
  return ring;
}

const feature = (geometry, properties = {}) => ({ type: "Feature", geometry, properties });
const collection = (features = []) => ({ type: "FeatureCollection", features });
const point = (coordinates, properties) => feature({ type: "Point", coordinates }, properties);
const polygon = (ring, properties) => feature({ type: "Polygon", coordinates: [ring] }, properties);

/** The outline of an answer, on the same side of the antimeridian as its position. */
const outlineOf = ({ outline_lon_lat_deg, lon_deg }) => (outline_lon_lat_deg ?? []).map(([lon, lat]) => [beside(lon, lon_deg), lat]);

/** The GeoJSON features of one answer. */
export function featuresOf({ number, answer, detail }, chosen) {
  if (answer?.state !== "fix") return [];
  const features = [point([answer.lon_deg, answer.lat_deg], { role: "fix", chosen, number })];
  const outline = outlineOf(answer);
  if (outline.length > 2) features.push(polygon([...outline, outline[0]], { role: "outline", chosen }));
  if (chosen) {
    features.push(polygon(circle(answer.lon_deg, answer.lat_deg, answer.radius95_m), { role: "circle" }));
    if (detail?.runner_up_lon_lat_deg) features.push(point(detail.runner_up_lon_lat_deg, { role: "runner-up" }));
  }
  return features;
}

/** Whether this browser can draw the map. */
export function canDraw() {
  const context = document.createElement("canvas").getContext("webgl2");
  // The context is not kept: browsers allow few.
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return context !== null;
}

export class MapView {
  constructor(container, token, onChoose) {
    this.token = token;
    this.map = new maplibregl.Map({
      container,
      // No glyphs and no sprites: they would be fetched.
      style: { version: 8, sources: {}, layers: [] },
      attributionControl: false,
      fadeDuration: 0,
      transformRequest: (url) => {
        const headers = {};
        if (this.token()) headers.authorization = `Bearer ${this.token()}`;
        return new URL(url, location.href).origin === location.origin ? { url, headers } : { url };
      },
    });
    this.map.addControl(new maplibregl.NavigationControl({ visualizePitch: false }), "top-left");
    this.map.addControl(new maplibregl.ScaleControl({}), "bottom-left");
    this.loaded = new Promise((resolve) => this.map.once("load", resolve));
    this.loaded.then(() => this.addLayers(onChoose));
  }

  addLayers(onChoose) {
    const { map } = this;
    for (const id of ["area", "answers", "track"]) map.addSource(id, { type: "geojson", data: collection() });
    const only = (role) => ["==", ["get", "role"], role];
    map.addLayer({ id: "area", type: "line", source: "area", paint: { "line-color": "#0b5cad", "line-width": 1.5, "line-dasharray": [3, 2] } });
    map.addLayer({ id: "circle", type: "fill", source: "answers", filter: only("circle"), paint: { "fill-color": "#ffd700", "fill-opacity": 0.3 } });
    map.addLayer({ id: "circle-line", type: "line", source: "answers", filter: only("circle"), paint: { "line-color": "#b8860b", "line-width": 2 } });
    map.addLayer({ id: "outline", type: "line", source: "answers", filter: only("outline"), paint: { "line-color": ["case", ["get", "chosen"], "#ffd700", "#ff8c00"], "line-width": ["case", ["get", "chosen"], 3, 1.5] } });
    map.addLayer({ id: "track-ellipse", type: "fill", source: "track", filter: only("ellipse"), paint: { "fill-color": "#7b3ff2", "fill-opacity": 0.2 } });
    map.addLayer({ id: "track-line", type: "line", source: "track", filter: only("line"), paint: { "line-color": "#7b3ff2", "line-width": 3 } });
    map.addLayer({ id: "track-point", type: "circle", source: "track", filter: only("position"), paint: { "circle-radius": 4, "circle-color": "#7b3ff2", "circle-stroke-color": "#ffffff", "circle-stroke-width": 1 } });
    map.addLayer({ id: "runner-up", type: "circle", source: "answers", filter: only("runner-up"), paint: { "circle-radius": 6, "circle-color": "#c62828", "circle-stroke-color": "#ffffff", "circle-stroke-width": 2 } });
    map.addLayer({ id: "fix", type: "circle", source: "answers", filter: only("fix"), paint: { "circle-radius": ["case", ["get", "chosen"], 7, 5], "circle-color": "#1b8a3a", "circle-stroke-color": "#ffffff", "circle-stroke-width": 2 } });
    map.on("click", "fix", (event) => onChoose(event.features[0].properties.number));
  }

  /** Shows a map of the service, as /v1/maps describes it. */
  async showMap(served) {
    await this.loaded;
    const { map } = this;
    for (const id of ["picture", "outlines"]) {
      if (map.getLayer(id)) map.removeLayer(id);
      if (map.getSource(id)) map.removeSource(id);
    }
    const [west, south, east, north] = served.bounds_deg;
    // Bounds of tiles end at the antimeridian: over it, all longitudes.
    const bounds = east > 180 ? [-180, south, 180, north] : served.bounds_deg;
    const tiles = (layer) => ({
      type: "raster",
      tileSize: 256,
      tiles: [`${location.origin}/v1/maps/${served.id}/tiles/{z}/{x}/{y}?layer=${layer}`],
      bounds,
      minzoom: served.minzoom,
      maxzoom: served.maxzoom,
    });
    if (served.has_picture) {
      map.addSource("picture", tiles("map"));
      map.addLayer({ id: "picture", type: "raster", source: "picture" }, "area");
    }
    map.addSource("outlines", tiles("outlines"));
    map.addLayer({ id: "outlines", type: "raster", source: "outlines", layout: { visibility: served.has_picture ? "none" : "visible" } }, "area");
    map.getSource("area").setData(collection([polygon(served.outline_lon_lat_deg)]));
    map.fitBounds([[west, south], [east, north]], { padding: 24, animate: false });
  }

  async showOutlines(visible) {
    await this.loaded;
    if (this.map.getLayer("outlines")) this.map.setLayoutProperty("outlines", "visibility", visible ? "visible" : "none");
  }

  /** Shows all answers, and the photo of the chosen one on the ground. */
  async showAnswers(entries, chosen, withPhoto) {
    await this.loaded;
    const { map } = this;
    map.getSource("answers").setData(collection(entries.flatMap((entry) => featuresOf(entry, entry === chosen))));
    if (map.getLayer("photo")) map.removeLayer("photo");
    if (map.getSource("photo")) map.removeSource("photo");
    const outline = chosen?.answer?.state === "fix" ? outlineOf(chosen.answer) : [];
    if (withPhoto && outline.length === 4 && chosen.canShow) {
      map.addSource("photo", { type: "image", url: chosen.url, coordinates: outline });
      map.addLayer({ id: "photo", type: "raster", source: "photo", paint: { "raster-opacity": 0.8, "raster-fade-duration": 0 } }, "circle");
    }
  }

  async goTo({ answer }) {
    await this.loaded;
    const bounds = new maplibregl.LngLatBounds();
    for (const at of [[answer.lon_deg, answer.lat_deg], ...outlineOf(answer)]) bounds.extend(at);
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.map.fitBounds(bounds, { padding: 80, maxZoom: 20, animate: !still });
  }

  async goToPosition(lonLat) {
    await this.loaded;
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.map.easeTo({ center: lonLat, animate: !still });
  }

  async showTrack(geojson) {
    await this.loaded;
    this.map.getSource("track").setData(geojson);
  }
}
