// The map page: photos in, answers on the map and in words.
import { ask, askJson, listOptions, locate, saveAs, ServiceError } from "/web/service.js";
import { connectTracks } from "/web/tracks.js";

const byId = (id) => document.getElementById(id);
const priorFields = ["heading", "pitch_deg", "height_agl_m", "hfov_deg", "near"];
// Photos, the last one first: each has a number and either an answer or an error.
const entries = [];
let lastNumber = 0;
// Of photos that are located again, by number: the latest request. An earlier one may be answered later, and does not count.
const latestRequests = new Map();
// The entry that was clicked last.
let clicked = null;
let maps = [];
let chosen = null;
let view = null;
// What the start has said, which its next success takes back.
let startError = "";

const token = () => byId("token").value.trim();
const say = (text) => { byId("status").textContent = text; };

function element(name, text, className) {
  const made = document.createElement(name);
  made.textContent = text;
  if (className) made.className = className;
  return made;
}

function fact(term, value) {
  return value === undefined || value === null ? [] : [element("dt", term), element("dd", value)];
}

const fixed = (value, decimals, unit) => (value === null || value === undefined ? null : `${value.toFixed(decimals)}${unit}`);

function factsOf({ answer, detail }) {
  const seconds = answer.time_ms.total === undefined ? null : `${(answer.time_ms.total / 1000).toFixed(2)} s`;
  return [
    ...fact("Latitude", fixed(answer.lat_deg, 7, "°")),
    ...fact("Longitude", fixed(answer.lon_deg, 7, "°")),
    ...fact("95 % radius", fixed(answer.radius95_m, 1, " m")),
    // 359.96 would be shown as 360.0.
    ...fact("Heading", fixed(answer.heading_deg >= 359.95 ? 0 : answer.heading_deg, 1, "°")),
    ...fact("Ground resolution", fixed(answer.gsd_m, 3, " m")),
    ...fact("Confidence", answer.confidence === null ? null : `${(100 * answer.confidence).toFixed(1)} %`),
    ...fact("Matches", answer.inliers === null ? null : `${answer.inliers} of ${answer.matches} agree`),
    ...fact("Runner-up", answer.runner_up_inliers === null ? null : `${answer.runner_up_inliers} agree`),
    ...fact("Assumed", answer.assumed),
    ...answer.used.flatMap((used) => fact(used.field, `${used.value}: ${used.reason}`)),
    ...answer.set_aside.flatMap((aside) => fact(aside.field, `${aside.value}, not used: ${aside.reason}`)),
    ...fact("Map", detail.map),
    ...fact("Time", seconds),
  ];
}

function showList() {
  // The buttons are made again: who stands on one stays there.
  const focused = document.activeElement?.closest("#answers button")?.dataset.number;
  const items = entries.map((entry) => {
    const button = document.createElement("button");
    button.type = "button";
    button.dataset.number = entry.number;
    button.setAttribute("aria-pressed", String(entry === chosen));
    const isFix = entry.answer?.state === "fix";
    const text = isFix ? `±${entry.answer.radius95_m.toFixed(1)} m` : entry.answer ? "no fix" : "error";
    button.append(element("span", entry.file.name, "name"), element("span", text, isFix ? "good" : "bad"));
    button.addEventListener("click", () => chooseOnItsMap(entry));
    const item = document.createElement("li");
    item.append(button);
    return item;
  });
  byId("answers").replaceChildren(...items);
  if (focused) byId("answers").querySelector(`[data-number="${focused}"]`)?.focus();
  byId("export").hidden = !entries.some((entry) => entry.answer);
  byId("again").disabled = chosen === null;
}

function showDetail() {
  byId("detail").hidden = chosen === null;
  if (chosen === null) return;
  const { answer, detail } = chosen;
  const picture = byId("matches");
  byId("detail-title").textContent = chosen.file.name;
  byId("reason").hidden = answer?.state === "fix";
  if (!answer) {
    byId("reason").textContent = `Error: ${chosen.error}`;
    byId("facts").replaceChildren();
    picture.hidden = true;
    return;
  }
  byId("reason").textContent = answer.state === "fix" ? "" : `No fix: ${answer.reason}`;
  byId("facts").replaceChildren(...factsOf(chosen));
  picture.hidden = !detail.matches_jpeg_base64;
  if (detail.matches_jpeg_base64) {
    picture.src = `data:image/jpeg;base64,${detail.matches_jpeg_base64}`;
    picture.alt = `Photo and map side by side; ${answer.inliers ?? 0} matches agree.`;
  }
  // What the photo's metadata say, as a hint in the empty fields.
  for (const [id, value] of [["heading", detail.heading_deg], ["pitch_deg", detail.pitch_deg], ["height_agl_m", detail.height_agl_m], ["hfov_deg", detail.hfov_deg]]) {
    byId(id).placeholder = value === null ? "" : value.toFixed(1);
  }
}

function draw() {
  view?.showAnswers(entries, chosen, byId("show-photo").checked);
}

function choose(entry) {
  chosen = entry;
  showList();
  showDetail();
  draw();
  // The map of a track may be shown meanwhile.
  if (entry.answer?.state === "fix" && entry.detail.map === byId("map-choice").value) view?.goTo(entry);
}

// For a click: shows the map of the answer, too.
async function chooseOnItsMap(entry) {
  clicked = entry;
  if (entry.detail) await showMap(entry.detail.map);
  // Another one may have been clicked meanwhile.
  if (clicked === entry) choose(entry);
}

// Puts an entry into the list, in the place of `replaced` if there is one, and chooses it.
function enter(entry, replaced) {
  entry.number = replaced?.number ?? ++lastNumber;
  const at = entries.findIndex((each) => each.number === entry.number);
  if (at >= 0) entries[at] = entry;
  else entries.unshift(entry);
  choose(entry);
}

// Browsers show JPEG, PNG and WebP; a TIFF is located and not shown.
const canShow = (file) => ["image/jpeg", "image/png", "image/webp"].includes(file.type);

async function locateFile(file, map, replaced) {
  say(`Locating ${file.name} …`);
  const prior = Object.fromEntries(priorFields.map((name) => [name, byId(name).value]));
  const request = {};
  if (replaced) latestRequests.set(replaced.number, request);
  const isOutdated = () => replaced !== null && latestRequests.get(replaced.number) !== request;
  try {
    // A photo may come before the maps: they wait for the token.
    if (maps.length === 0) await readMaps();
    const onMap = map || byId("map-choice").value;
    const busy = ({ message, retryAfterS }) => {
      if (!isOutdated()) say(`${file.name}: ${message} (the next try is in ${retryAfterS} s)`);
    };
    const { detail, ...answer } = await locate(file, onMap, prior, token(), busy);
    if (isOutdated()) return;
    enter({ answer, detail, file, url: replaced?.url ?? URL.createObjectURL(file), canShow: canShow(file) }, replaced);
    say(answer.state === "fix"
      ? `${file.name}: ${answer.lat_deg.toFixed(6)}, ${answer.lon_deg.toFixed(6)}, within ${answer.radius95_m.toFixed(1)} m.`
      : `${file.name}: no fix. ${answer.reason}`);
  } catch (error) {
    if (!(error instanceof ServiceError)) throw error;
    if (isOutdated()) return;
    // An answer that is there stays.
    if (!replaced?.answer) enter({ error: error.message, file }, replaced);
    say(`${file.name}: ${error.message}`);
    if (error.status === 401) askForToken();
  }
}

async function locateFiles(files, replaced = null) {
  // All on one map, whatever is shown meanwhile.
  const map = byId("map-choice").value;
  for (const file of files) await locateFile(file, map, replaced);
}

function askForToken() {
  byId("settings").open = true;
  byId("token").focus();
}

async function readMaps() {
  ({ maps } = await askJson("/v1/maps", token()));
  listOptions(byId("map-choice"), maps.map(({ id }) => new Option(id)));
  await showChosenMap();
}

async function showChosenMap() {
  const map = maps.find((each) => each.id === byId("map-choice").value);
  if (!map) return;
  byId("show-outlines").checked = !map.has_picture;
  await view?.showMap(map);
}

// Shows the map of an answer or a track.
async function showMap(id) {
  if (byId("map-choice").value === id || !maps.some((each) => each.id === id)) return;
  byId("map-choice").value = id;
  await showChosenMap();
}

async function save(button) {
  const { name, type } = button.dataset;
  const count = entries.length;
  // The first photo first, as in the files of `grim locate`.
  const answers = entries.flatMap((entry) => entry.answer ?? []).reverse();
  // GPX has no place for a photo without a fix.
  const isGpx = type === "application/gpx+xml";
  const saved = isGpx ? answers.filter((answer) => answer.state === "fix") : answers;
  try {
    const response = await ask("/v1/answers", token(), {
      method: "POST",
      headers: { accept: type, "content-type": "application/json" },
      body: JSON.stringify(saved),
    });
    saveAs(await response.blob(), name);
    say(saved.length === count
      ? `Saved ${name}.`
      : `Saved ${name} with ${saved.length} of ${count} photos: those without ${isGpx ? "a fix" : "an answer"} are left out.`);
  } catch (error) {
    say(error.message);
  }
}

function connectInputs() {
  const drop = document.body;
  for (const name of ["dragenter", "dragover"]) {
    drop.addEventListener(name, (event) => { event.preventDefault(); byId("drop").classList.add("over"); });
  }
  for (const name of ["dragleave", "drop"]) {
    drop.addEventListener(name, (event) => { event.preventDefault(); byId("drop").classList.remove("over"); });
  }
  drop.addEventListener("drop", (event) => locateFiles([...event.dataTransfer.files]));
  byId("files").addEventListener("change", async (event) => {
    const files = [...event.target.files];
    // The same photo may be chosen again.
    event.target.value = "";
    await locateFiles(files);
  });
  byId("again").addEventListener("click", () => locateFiles([chosen.file], chosen));
  byId("map-choice").addEventListener("change", showChosenMap);
  byId("show-outlines").addEventListener("change", (event) => view?.showOutlines(event.target.checked));
  byId("show-photo").addEventListener("change", draw);
  byId("token").addEventListener("change", start);
  for (const button of byId("export").querySelectorAll("button")) button.addEventListener("click", () => save(button));
}

async function openView() {
  const { canDraw, MapView } = await import("/web/map_view.js");
  if (!canDraw()) {
    byId("no-map").hidden = false;
    byId("no-map").textContent = "This browser has no WebGL 2, so the map cannot be drawn. Photos are located all the same.";
    return;
  }
  view = new MapView("map", token, (number) => {
    const entry = entries.find((each) => each.number === number);
    if (entry) chooseOnItsMap(entry);
  });
  // For tests: what is drawn.
  window.grimnet = { map: view.map, loaded: view.loaded };
}

async function start() {
  try {
    await readMaps();
    // A photo may have been located before the map was drawn: what was said of it stays.
    if (byId("status").textContent === startError) say("");
  } catch (error) {
    if (!(error instanceof ServiceError)) throw error;
    startError = error.message;
    say(error.message);
    if (error.status === 401) askForToken();
  }
}

connectInputs();
connectTracks({
  token,
  showMap,
  showTrack: (geojson) => view?.showTrack(geojson),
  goTo: (lonLat) => view?.goToPosition(lonLat),
});
await openView();
await start();
