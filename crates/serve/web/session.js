// The view of a session file: a map of pictures, a track over it, and a slider for its frames. It asks for nothing from anywhere.
// Stands in one script with track_shapes.js.

const session = JSON.parse(document.getElementById("session").textContent);
const byId = (id) => document.getElementById(id);
const COLOURS = { searching: "#8a8f98", tracking: "#1f9d55", coasting: "#d97706", ambiguous: "#9333ea", lost: "#dc2626" };
const FRAMES_PER_SECOND = 4;
const canvas = byId("view");
const slider = byId("slider");
const { frames, tiles } = session;

/** Web Mercator (EPSG:3857), the world from 0 to 1, y to the south. */
const worldOf = (lon, lat) => [lon / 360 + 0.5, 0.5 - Math.asinh(Math.tan((lat * Math.PI) / 180)) / (2 * Math.PI)];
const longitudes = session.outline_lon_lat_deg.map(([lon]) => lon);
// The outline goes on over the antimeridian, where the longitudes of positions begin again.
const middle = (Math.min(...longitudes) + Math.max(...longitudes)) / 2;
const shapes = frames.map(({ point }) => {
  if (point?.lat_deg === undefined) return null;
  const lon_deg = beside(point.lon_deg, middle);
  return {
    at: worldOf(lon_deg, point.lat_deg),
    ellipse: ellipse({ ...point, lon_deg }).map(([lon, lat]) => worldOf(lon, lat)),
  };
});
const outline = session.outline_lon_lat_deg.map(([lon, lat]) => worldOf(lon, lat));
const pictures = tiles.map((tile) => {
  const image = new Image();
  image.onload = draw;
  image.src = tile.picture;
  return { image, ...tile };
});

/** The middle of the view in the world, and pixels of the screen for the world. */
const view = { x: 0.5, y: 0.5, scale: 256 };

function fit() {
  const [xs, ys] = [0, 1].map((axis) => outline.map((point) => point[axis]));
  const [left, right, top, bottom] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  view.x = (left + right) / 2;
  view.y = (top + bottom) / 2;
  view.scale = 0.95 * Math.min(canvas.clientWidth / (right - left), canvas.clientHeight / (bottom - top));
}

function draw() {
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  const onScreen = ([x, y]) => [(x - view.x) * view.scale + width / 2, (y - view.y) * view.scale + height / 2];
  const path = (points) => {
    context.beginPath();
    for (const point of points) context.lineTo(...onScreen(point));
  };
  for (const { image, west, north, side } of pictures) {
    if (!image.complete || !image.naturalWidth) continue;
    const [x, y] = onScreen([west, north]);
    // Half a pixel more, so that no seam shows.
    context.drawImage(image, x, y, side * view.scale + 0.5, side * view.scale + 0.5);
  }
  context.lineWidth = 1.5;
  context.strokeStyle = "#1e78dc";
  path(outline);
  context.stroke();
  const upTo = Number(slider.value);
  let before = null;
  frames.forEach((frame, index) => {
    if (index > upTo) return;
    if (!shapes[index]) {
      before = null;
      return;
    }
    const colour = COLOURS[frame.point.state];
    const { at } = shapes[index];
    if (usable(frame.point) && before) {
      context.lineWidth = 3;
      context.strokeStyle = colour;
      path([before, at]);
      context.stroke();
    }
    before = usable(frame.point) ? at : null;
    context.fillStyle = colour;
    context.beginPath();
    context.arc(...onScreen(at), 2.5, 0, 2 * Math.PI);
    context.fill();
  });
  if (shapes[upTo]) {
    const colour = COLOURS[frames[upTo].point.state];
    context.lineWidth = 2;
    context.strokeStyle = colour;
    context.fillStyle = `${colour}44`;
    path(shapes[upTo].ellipse);
    context.fill();
    context.stroke();
    context.fillStyle = "#ffffff";
    context.beginPath();
    context.arc(...onScreen(shapes[upTo].at), 5, 0, 2 * Math.PI);
    context.fill();
    context.stroke();
  }
}

function show() {
  byId("status").textContent = frames.length ? frameText(frames[Number(slider.value)]) : "The track has no frame.";
  draw();
}

function zoom(factor, atX = canvas.clientWidth / 2, atY = canvas.clientHeight / 2) {
  const to = Math.min(Math.max(view.scale * factor, 256), 256 * 2 ** 26);
  // What is under the pointer stays there.
  const [dx, dy] = [atX - canvas.clientWidth / 2, atY - canvas.clientHeight / 2];
  view.x += dx / view.scale - dx / to;
  view.y += dy / view.scale - dy / to;
  view.scale = to;
  draw();
}

function move(dx, dy) {
  view.x -= dx / view.scale;
  view.y -= dy / view.scale;
  draw();
}

let timer = null;
function play() {
  const stop = timer !== null;
  clearInterval(timer);
  timer = null;
  byId("play").textContent = stop ? "Play" : "Pause";
  // Screen readers would have more to say than there is time for.
  byId("status").setAttribute("aria-live", stop ? "polite" : "off");
  if (stop) return;
  if (slider.value === slider.max) slider.value = 0;
  timer = setInterval(() => {
    slider.value = Number(slider.value) + 1;
    show();
    if (slider.value === slider.max) play();
  }, 1000 / FRAMES_PER_SECOND);
}

byId("title").textContent = session.title;
document.title = byId("title").textContent;
for (const [state, colour] of Object.entries(COLOURS)) {
  const entry = document.createElement("li");
  entry.textContent = state;
  entry.style.setProperty("--colour", colour);
  byId("legend").append(entry);
}
slider.min = 0;
slider.max = Math.max(frames.length - 1, 0);
slider.value = slider.max;
slider.addEventListener("input", show);
byId("play").addEventListener("click", play);
byId("play").disabled = frames.length < 2;
byId("nearer").addEventListener("click", () => zoom(1.5));
byId("farther").addEventListener("click", () => zoom(1 / 1.5));
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  zoom(2 ** (-event.deltaY / 300), event.offsetX, event.offsetY);
}, { passive: false });
canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
canvas.addEventListener("pointermove", (event) => {
  if (canvas.hasPointerCapture(event.pointerId)) move(event.movementX, event.movementY);
});
canvas.addEventListener("keydown", (event) => {
  const step = { ArrowLeft: [40, 0], ArrowRight: [-40, 0], ArrowUp: [0, 40], ArrowDown: [0, -40] }[event.key];
  if (step) move(...step);
  else if (event.key === "+" || event.key === "-") zoom(event.key === "+" ? 1.5 : 1 / 1.5);
  else return;
  event.preventDefault();
});
new ResizeObserver(draw).observe(canvas);
fit();
show();
