// Tracks: followed as their frames come, and looked through afterwards.
import { ask, askJson, listOptions, saveAs, ServiceError } from "/web/service.js";
import { beside, ellipse, frameText, usable } from "/web/track_shapes.js";

/** Pause before a connection that broke is tried again. */
const RETRY_MS = 2000;
/** What a proxy says of a service that is away, or a service that has no place for a listener now. */
const AWAY_STATUSES = [502, 503, 504];

const byId = (id) => document.getElementById(id);

/** What is drawn of the frames up to one of them: a line for each part in which the position can be used. */
export function drawn(frames, upTo) {
  const isKnown = ({ point }) => point?.lat_deg !== undefined;
  const shown = frames.filter((frame) => frame.number <= upTo);
  const first = shown.find(isKnown);
  const at = ({ point }) => [beside(point.lon_deg, first.point.lon_deg), point.lat_deg];
  const parts = [[]];
  // Some frames come late: lines go in order of time.
  for (const frame of [...shown].sort((a, b) => a.time_s - b.time_s)) {
    if (isKnown(frame) && usable(frame.point)) parts.at(-1).push(at(frame));
    else parts.push([]);
  }
  const lines = parts.filter((part) => part.length > 1);
  const feature = (type, coordinates, role) => ({ type: "Feature", geometry: { type, coordinates }, properties: { role } });
  const features = [];
  if (lines.length) features.push(feature("MultiLineString", lines, "line"));
  const last = shown.findLast(isKnown);
  if (last) {
    const [lon_deg] = at(last);
    features.push(feature("Polygon", [ellipse({ ...last.point, lon_deg })], "ellipse"));
    features.push(feature("Point", at(last), "position"));
  }
  return { type: "FeatureCollection", features };
}

/** A track that the service does not have: it was ended, or given up for a new one. */
const isGone = (error) => error instanceof ServiceError && error.status === 404;

/**
 * Reads the events of a track until the track ends or `signal` aborts; a broken connection is resumed after the last frame.
 * `onConnection` is called with true whenever there is a connection, with false whenever there is none. Throws if the service does not
 * have the track at all.
 */
async function follow(id, token, signal, onConnection, onFrame) {
  let last = 0;
  let isBegun = false;
  while (!signal.aborted) {
    // Not EventSource: it cannot send a token.
    const headers = { "last-event-id": String(last) };
    try {
      const response = await ask(`/v1/tracks/${id}/events`, token, { headers, signal });
      isBegun = true;
      onConnection(true);
      const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
      let text = "";
      for (;;) {
        const { value, done } = await reader.read();
        if (done) break;
        text += value;
        const events = text.split("\n\n");
        text = events.pop();
        for (const event of events) {
          const data = event.split("\n").filter((line) => line.startsWith("data:")).map((line) => line.slice(5).trim()).join("\n");
          if (!data) continue;
          const frame = JSON.parse(data);
          last = frame.number;
          onFrame(frame);
        }
      }
    } catch (error) {
      if (signal.aborted || (isBegun && isGone(error))) return;
      const isAway = isBegun && AWAY_STATUSES.includes(error.status);
      if (error instanceof ServiceError && error.status && !isAway) throw error;
      onConnection(false);
    }
    await new Promise((resolve) => setTimeout(resolve, RETRY_MS));
  }
}

/** Connects the inputs of the page. `showMap` takes the name of a map, `goTo` a longitude and latitude. */
export function connectTracks({ token, showMap, showTrack, goTo }) {
  const say = (text) => { byId("track-status").textContent = text; };
  const sayError = (error, id) => say(isGone(error) ? `The service does not have track ${id} any more. List the tracks again.` : error.message);
  const slider = byId("track-slider");
  let tracks = [];
  let frames = [];
  let following = null;
  let isShowing = false;

  const show = () => {
    const upTo = Number(slider.value);
    showTrack(drawn(frames, upTo));
    const frame = frames.findLast((each) => each.number <= upTo);
    say(frame ? frameText(frame) : "The track has no frame yet.");
  };
  // Once for all frames that come between two pictures of the screen: a long track is replayed at once.
  const showSoon = () => {
    if (isShowing) return;
    isShowing = true;
    requestAnimationFrame(() => {
      isShowing = false;
      show();
    });
  };

  byId("read-tracks").addEventListener("click", async () => {
    try {
      ({ tracks } = await askJson("/v1/tracks", token()));
      listOptions(byId("track-choice"), tracks.map((track) => new Option(`${track.id} on ${track.map}, ${track.frames} frames`, track.id)));
      byId("follow").disabled = byId("save-track").disabled = tracks.length === 0;
      say(tracks.length === 0 ? "There are no tracks: a program begins one with POST /v1/tracks." : "");
    } catch (error) {
      say(error.message);
    }
  });
  byId("follow").addEventListener("click", async () => {
    following?.abort();
    following = new AbortController();
    const { signal } = following;
    const id = byId("track-choice").value;
    frames = [];
    slider.disabled = false;
    slider.max = slider.min = 1;
    // What is shown is the track before.
    show();
    let isPlaced = false;
    try {
      const map = tracks.find((track) => String(track.id) === id)?.map;
      if (map !== undefined) await showMap(map);
      const onConnection = (isThere) => {
        if (isThere) show();
        else say(`There is no connection to the service, which is tried again: what is shown of track ${id} may be old.`);
      };
      await follow(id, token(), signal, onConnection, (frame) => {
        const atEnd = slider.value === slider.max;
        frames.push(frame);
        slider.min = frames[0].number;
        slider.max = frame.number;
        if (atEnd) slider.value = frame.number;
        if (!isPlaced && frame.point?.lat_deg !== undefined) {
          isPlaced = true;
          goTo([frame.point.lon_deg, frame.point.lat_deg]);
        }
        showSoon();
      });
      if (!signal.aborted) say(`Track ${id} has ended. Its ${frames.length} frames stay here until another track is followed.`);
    } catch (error) {
      if (!signal.aborted) sayError(error, id);
    }
  });
  byId("save-track").addEventListener("click", async () => {
    const id = byId("track-choice").value;
    try {
      const response = await ask(`/v1/tracks/${id}/session`, token());
      saveAs(await response.blob(), `track-${id}.html`);
      say(`Saved track-${id}.html, which opens without this service.`);
    } catch (error) {
      sayError(error, id);
    }
  });
  slider.addEventListener("input", show);
}
