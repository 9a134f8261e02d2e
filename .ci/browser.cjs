// Drives the page of `grim serve` in chromium. Called by .ci/browser.
// Usage: node browser.cjs URL PHOTOS OUT
"use strict";

const assert = require("node:assert/strict");
const fs = require("node:fs");
const path = require("node:path");
const { chromium } = require("playwright-core");

const [url, photos, out] = process.argv.slice(2);
const files = fs.readdirSync(photos).filter((name) => name.endsWith(".jpg")).sort().map((name) => path.join(photos, name));
// Only a watchdog.
const timeout = 120000;
let passed = 0;

async function check(name, run) {
  await run();
  passed += 1;
  console.log(`ok - ${name}`);
}

function watch(page) {
  const seen = { errors: [], hosts: new Set(), bytes: 0 };
  page.on("console", (message) => {
    if (["error", "warning"].includes(message.type())) seen.errors.push(message.text());
  });
  page.on("pageerror", (error) => seen.errors.push(String(error)));
  page.on("request", (request) => {
    const address = new URL(request.url());
    if (!["blob:", "data:"].includes(address.protocol)) seen.hosts.add(address.origin);
  });
  page.on("response", async (response) => {
    if (!new URL(response.url()).pathname.startsWith("/v1/")) {
      seen.bytes += (await response.request().sizes().catch(() => ({ responseBodySize: 0 }))).responseBodySize;
    }
  });
  return seen;
}

// The map draws once more: where it has drawn all already, it would say nothing.
const idle = (page) => page.evaluate(async () => {
  const { map } = window.grimnet;
  const drawn = map.once("idle");
  map.triggerRepaint();
  await drawn;
});

const status = (page, text) => page.waitForFunction((text) => document.getElementById("status").textContent.includes(text), text, { timeout });

async function main() {
  const browser = await chromium.launch({
    executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
    args: ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
  });
  const page = await browser.newPage({ viewport: { width: 1280, height: 800 } });
  const seen = watch(page);
  await page.goto(url);

  await check("the map is drawn", async () => {
    await page.waitForFunction(() => window.grimnet?.map.loaded() && window.grimnet.map.getLayer("picture"), null, { timeout });
    await page.waitForFunction(() => window.grimnet.map.areTilesLoaded(), null, { timeout });
    assert.ok(seen.bytes > 100000 && seen.bytes < 2000000, `${seen.bytes} bytes were transferred`);
    console.log(`# page: ${seen.bytes} bytes`);
    assert.ok(!(await page.isVisible("#export")), "there is nothing to save");
  });

  await check("a photo becomes a fix on the map", async () => {
    await page.setInputFiles("#files", files[0]);
    await status(page, "within");
    await page.waitForFunction(() => window.grimnet.map.queryRenderedFeatures({ layers: ["fix", "circle", "outline"] }).length >= 3, null, { timeout });
    const facts = await page.textContent("#facts");
    for (const term of ["Latitude", "95 % radius", "Matches", "RelativeAltitude"]) assert.ok(facts.includes(term), `${term} in ${facts}`);
    assert.ok(await page.isVisible("#matches"));
    assert.ok((await page.getAttribute("#matches", "alt")).includes("agree"));
    assert.notEqual(await page.getAttribute("#hfov_deg", "placeholder"), "", "filled in from the metadata");
    await page.waitForFunction(() => window.grimnet.map.loaded(), null, { timeout });
    await page.screenshot({ path: path.join(out, "fix.png") });
  });

  await check("a wrong setting gives no fix or an error, in words", async () => {
    await page.click("#settings summary");
    await page.fill("#hfov_deg", "400");
    await page.click("#again");
    await status(page, "hfov_deg");
    await page.fill("#hfov_deg", "");
    await page.fill("#near", "0,0,100");
    await page.click("#again");
    await page.waitForFunction(() => !document.getElementById("reason").hidden || document.getElementById("status").textContent.includes("near"), null, { timeout });
    await page.screenshot({ path: path.join(out, "no_fix.png") });
    await page.fill("#near", "");
  });

  await check("a file that is no photo is refused in words, which stay in the list", async () => {
    await page.setInputFiles("#files", [
      { name: "notes.jpg", mimeType: "image/jpeg", buffer: Buffer.from("no picture") },
      { name: "same.jpg", mimeType: "image/jpeg", buffer: fs.readFileSync(files[1]) },
    ]);
    await status(page, "same.jpg");
    await status(page, "within");
    const list = await page.$$eval("#answers li", (all) => all.map((each) => each.textContent));
    assert.equal(list.length, 3, list);
    assert.equal(list[1], "notes.jpgerror");
    await page.click("#answers li:nth-child(2) button");
    assert.ok((await page.textContent("#reason")).includes("not a picture"));
    assert.ok(!(await page.isVisible("#matches")));
    await page.click("#again");
    await status(page, "notes.jpg: ");
    assert.equal(await page.locator("#answers li").count(), 3);
  });

  await check("of two photos of one name, the one whose fix is clicked is chosen", async () => {
    await page.setInputFiles("#files", { name: "same.jpg", mimeType: "image/jpeg", buffer: fs.readFileSync(files[2]) });
    await page.waitForFunction(() => document.querySelectorAll("#answers li").length === 4, null, { timeout });
    // The older one is the third, and its facts are those that a click on its fix must show.
    await page.click("#answers li:nth-child(2) button");
    const older = await page.textContent("#facts");
    await idle(page);
    const at = await page.evaluate(() => {
      const { map } = window.grimnet;
      const fix = map.queryRenderedFeatures({ layers: ["fix"] }).find((each) => each.properties.chosen);
      map.jumpTo({ center: fix.geometry.coordinates, zoom: map.getZoom() + 2 });
      return fix.geometry.coordinates;
    });
    await page.click("#answers li:first-child button");
    assert.notEqual(await page.textContent("#facts"), older);
    await idle(page);
    await page.evaluate((at) => window.grimnet.map.jumpTo({ center: at }), at);
    await idle(page);
    const [x, y] = await page.evaluate((at) => {
      const { map } = window.grimnet;
      const { x, y } = map.project(at);
      const { left, top } = map.getContainer().getBoundingClientRect();
      return [left + x, top + y];
    }, at);
    await page.mouse.click(x, y);
    await page.waitForFunction((older) => document.getElementById("facts").textContent === older, older, { timeout });
  });

  await check("a photo that was changed after it was chosen is not taken for a service that is away", async () => {
    const changed = path.resolve(out, "changed.jpg");
    const other = await browser.newPage();
    await other.goto(url);
    fs.writeFileSync(changed, "no picture");
    await other.setInputFiles("#files", changed);
    await status(other, "not a picture");
    fs.writeFileSync(changed, "another size");
    await other.click("#settings summary");
    await other.click("#again");
    await status(other, "changed.jpg: This browser cannot read it");
    await other.close();
  });

  await check("an answer that breaks off is an error of its photo, and the next photo is located", async () => {
    const other = await browser.newPage();
    await other.goto(url);
    let asked = 0;
    await other.route("**/v1/locate*", (route) => {
      asked += 1;
      return asked > 1 ? route.continue() : route.fulfill({ contentType: "application/json", body: "{\"photo\":\"a" });
    });
    await other.setInputFiles("#files", files.slice(0, 2));
    await status(other, "within");
    const list = await other.$$eval("#answers li", (all) => all.map((each) => each.textContent));
    assert.equal(list[1], `${path.basename(files[0])}error`);
    await other.close();
  });

  await check("the answer of a photo that comes before the map is drawn stays", async () => {
    const early = await browser.newPage();
    let draw;
    const mayDraw = new Promise((resolve) => { draw = resolve; });
    await early.route("**/web/map_view.js", async (route) => {
      await mayDraw;
      await route.continue();
    });
    await early.goto(url);
    await early.setInputFiles("#files", files[0]);
    await status(early, "within");
    await early.selectOption("#map-choice", "other");
    draw();
    await early.waitForFunction(() => window.grimnet?.map.loaded() && window.grimnet.map.getLayer("picture"), null, { timeout });
    assert.ok((await early.textContent("#status")).includes("within"));
    assert.equal(await early.inputValue("#map-choice"), "other");
    await early.close();
  });

  await check("of two requests for one photo the later one counts, also where it is answered first", async () => {
    const other = await browser.newPage();
    await other.goto(url);
    await other.setInputFiles("#files", files[0]);
    await status(other, "within");
    let answer;
    const mayAnswer = new Promise((resolve) => { answer = resolve; });
    let asked = 0;
    await other.route("**/v1/locate*", async (route) => {
      asked += 1;
      if (asked === 1) await mayAnswer;
      await route.continue();
    });
    await other.click("#settings summary");
    await other.fill("#near", "0,0,100");
    await other.click("#again");
    await other.fill("#near", "");
    await other.click("#again");
    await status(other, "within");
    const late = other.waitForResponse("**/v1/locate*", { timeout });
    answer();
    await (await late).finished();
    await other.waitForTimeout(500);
    assert.ok((await other.textContent("#answers")).includes("±"));
    await other.close();
  });

  await check("a busy service is asked again", async () => {
    let asked = 0;
    await page.route("**/v1/locate*", (route) => {
      asked += 1;
      if (asked > 1) return route.continue();
      return route.fulfill({ status: 503, headers: { "retry-after": "1" }, contentType: "application/problem+json", body: JSON.stringify({ detail: "1 localisation runs" }) });
    });
    await page.setInputFiles("#files", files[1]);
    await status(page, "the next try is in 1 s");
    await status(page, "within");
    assert.equal(asked, 2);
    await page.unroute("**/v1/locate*");
  });

  await check("the keyboard reaches everything", async () => {
    await page.focus("#answers li:last-child button");
    await page.keyboard.press("Enter");
    assert.equal(await page.getAttribute("#answers li:last-child button", "aria-pressed"), "true");
    assert.ok(await page.$eval("#answers li:last-child button", (button) => button === document.activeElement), "the focus stays");
    const unnamed = await page.$$eval("button, input, select, a", (all) => all.filter((each) => !each.textContent.trim() && !each.labels?.length && !each.getAttribute("aria-label") && !each.title).map((each) => each.outerHTML));
    assert.deepEqual(unnamed, []);
  });

  await check("answers are saved as GeoJSON, GPX, KML and CSV", async () => {
    const photo = 'a "b" ä.jpg';
    await page.setInputFiles("#files", { name: photo, mimeType: "image/jpeg", buffer: fs.readFileSync(files[0]) });
    await status(page, `${photo}: `);
    for (const [name, words] of [["fixes.geojson", "FeatureCollection"], ["fixes.gpx", "<wpt "], ["fixes.kml", "<Placemark>"], ["fixes.csv", '"a ""b"" ä.jpg",']]) {
      const [download] = await Promise.all([page.waitForEvent("download"), page.click(`#export [data-name='${name}']`)]);
      const text = fs.readFileSync(await download.path(), "utf8");
      assert.ok(text.includes(words), text);
      await status(page, `Saved ${name}`);
      const said = await page.textContent("#status");
      assert.ok(/ with \d+ of \d+ photos: those without an? (answer|fix) are left out/.test(said), `notes.jpg has no answer: ${said}`);
      if (name === "fixes.csv") {
        const rows = text.trimEnd().split("\n").slice(1);
        assert.ok(rows.at(-1).startsWith('"a ""b"" ä.jpg",'), `the photo that came last is the last row: ${text}`);
      }
    }
  });

  await check("a track is followed as it comes", async () => {
    const post = (path, body, type) => fetch(url + path, { method: "POST", body, headers: type ? { "content-type": type } : {} });
    const track = await (await post("/v1/tracks", JSON.stringify({ map: "other" }))).json();
    const frame = async (number) => {
      const answer = await post(`/v1/tracks/${track.id}/frames?time_s=${number}`, fs.readFileSync(files[number]), "image/jpeg");
      assert.equal(answer.status, 200, await answer.text());
    };
    await frame(0);
    await page.click("#tracks summary");
    await page.click("#read-tracks");
    await page.waitForFunction(() => document.getElementById("track-choice").options.length > 0, null, { timeout });
    assert.equal(await page.inputValue("#map-choice"), "area");
    await page.click("#follow");
    await page.waitForFunction(() => document.getElementById("track-status").textContent.includes("frame 1"), null, { timeout });
    assert.equal(await page.inputValue("#map-choice"), "other");
    // The map moves to the track.
    await page.waitForFunction(() => window.grimnet.map.queryRenderedFeatures({ layers: ["track-point"] }).length > 0, null, { timeout });
    await page.waitForFunction(() => {
      const { map } = window.grimnet;
      const [fix] = map.queryRenderedFeatures({ layers: ["track-point"] });
      if (!fix) return false;
      const [at, middle] = [map.project(fix.geometry.coordinates), map.project(map.getCenter())];
      return Math.hypot(at.x - middle.x, at.y - middle.y) < 20;
    }, null, { timeout });
    await frame(1);
    await page.waitForFunction(() => document.getElementById("track-status").textContent.includes("frame 2"), null, { timeout });
    await page.screenshot({ path: path.join(out, "track.png") });
    // Nothing of it is left when another one is followed.
    const empty = await (await post("/v1/tracks", JSON.stringify({ map: "other" }))).json();
    await page.click("#read-tracks");
    await page.waitForFunction(() => document.getElementById("track-choice").options.length > 1, null, { timeout });
    await page.selectOption("#track-choice", String(empty.id));
    await page.click("#follow");
    await page.waitForFunction(() => document.getElementById("track-status").textContent.includes("no frame yet"), null, { timeout });
    await page.waitForFunction(() => window.grimnet.map.queryRenderedFeatures({ layers: ["track-point"] }).length === 0, null, { timeout });
    // It stays the chosen one when the tracks are listed again.
    await page.evaluate(() => { document.getElementById("track-choice").options[0].textContent = "listed before"; });
    await page.click("#read-tracks");
    await page.waitForFunction(() => document.getElementById("track-choice").options[0].textContent !== "listed before", null, { timeout });
    assert.equal(await page.inputValue("#track-choice"), String(empty.id));
    await page.selectOption("#track-choice", String(track.id));
    await page.click("#follow");
    await page.waitForFunction(() => document.getElementById("track-status").textContent.includes("frame 2"), null, { timeout });
    // Events have no end: the page to try the API shows them as they come, after the frame of its header field.
    const api = await browser.newPage();
    await api.goto(`${url}/api`);
    const section = api.locator("section", { hasText: "/v1/tracks/{id}/events" }).filter({ hasText: "Follows a track" });
    await section.locator("input[name=id]").fill(String(track.id));
    await section.locator("input[name=last-event-id]").fill("1");
    await section.locator("button").click();
    await section.locator("pre", { hasText: "id: 2" }).waitFor({ timeout });
    assert.ok(!(await section.locator("pre").textContent()).includes("id: 1"));
    await section.locator("input[name=last-event-id]").fill("");
    await section.locator("button").click();
    await section.locator("pre", { hasText: "id: 1" }).waitFor({ timeout });
    await api.close();
  });

  await check("a long track is drawn once for many frames", async () => {
    const count = 5000;
    const frame = (number) => ({ number, time_s: number, point: { state: "tracking", lat_deg: 1 + 1e-6 * number, lon_deg: 1.5, radius95_m: 3, covariance_en_m2: [1, 0, 1] } });
    const events = Array.from({ length: count }, (_, i) => `event: frame\nid: ${i + 1}\ndata: ${JSON.stringify(frame(i + 1))}\n\n`);
    const long = await browser.newPage();
    await long.route("**/v1/tracks", (route) => route.fulfill({ json: { tracks: [{ id: 9, map: "area", frames: count }] } }));
    await long.route("**/v1/tracks/9/events", (route) => (route.request().headers()["last-event-id"] === "0"
      ? route.fulfill({ contentType: "text/event-stream", body: events.join("") })
      : route.fulfill({ status: 502, contentType: "text/html", body: "Bad Gateway" })));
    await long.goto(url);
    await long.waitForFunction(() => window.grimnet?.map.getSource("track"), null, { timeout });
    await long.evaluate(() => {
      const source = window.grimnet.map.getSource("track");
      const { setData } = source;
      window.drawings = 0;
      source.setData = function (...data) {
        window.drawings += 1;
        return setData.apply(this, data);
      };
    });
    await long.click("#tracks summary");
    await long.click("#read-tracks");
    await long.waitForFunction(() => document.getElementById("track-choice").options.length > 0, null, { timeout });
    await long.click("#follow");
    await long.waitForFunction((count) => document.getElementById("track-status").textContent.includes(`frame ${count} `), count, { timeout });
    const drawings = await long.evaluate(() => window.drawings);
    assert.ok(drawings < count / 10, `${drawings} drawings`);
    // The connection ended, and a proxy says that there is no other.
    await long.waitForFunction(() => document.getElementById("track-status").textContent.includes("no connection"), null, { timeout });
    await long.close();
  });

  await check("a track is saved as one file, which opens without the service", async () => {
    const [download] = await Promise.all([page.waitForEvent("download"), page.click("#save-track")]);
    const file = path.resolve(out, "session.html");
    await download.saveAs(file);
    const alone = await browser.newPage({ viewport: { width: 900, height: 700 } });
    const asked = [];
    const errors = [];
    alone.on("request", (request) => { if (!request.url().startsWith("data:")) asked.push(request.url()); });
    alone.on("console", (message) => errors.push(message.text()));
    alone.on("pageerror", (error) => errors.push(String(error)));
    await alone.goto(`file://${file}`);
    const shown = (text) => alone.waitForFunction((text) => document.getElementById("status").textContent.includes(text), text, { timeout });
    await shown("at frame 2 (1 s)");
    await alone.focus("#slider");
    await alone.keyboard.press("ArrowLeft");
    await shown("at frame 1 (0 s)");
    await alone.click("#play");
    await shown("at frame 2 (1 s)");
    // The map's pictures are drawn: many colours.
    const colours = await alone.evaluate(() => {
      const view = document.getElementById("view");
      const { data } = view.getContext("2d").getImageData(0, 0, view.width, view.height);
      const found = new Set();
      for (let at = 0; at < data.length; at += 4 * 97) found.add((data[at] << 16) | (data[at + 1] << 8) | data[at + 2]);
      return found.size;
    });
    assert.ok(colours > 300, `${colours} colours`);
    await alone.click("#nearer");
    await alone.focus("#view");
    await alone.keyboard.press("ArrowUp");
    await alone.mouse.move(450, 350);
    await alone.mouse.wheel(0, -300);
    await alone.screenshot({ path: path.join(out, "session.png") });
    assert.deepEqual(errors, []);
    assert.deepEqual(asked, [`file://${file}`]);
    console.log(`# session: ${fs.statSync(file).size} bytes`);
    await alone.close();
  });

  await check("a track that ends while it is followed says so, in words", async () => {
    const trackStatus = (text) => page.waitForFunction((text) => document.getElementById("track-status").textContent.includes(text), text, { timeout });
    const id = await page.inputValue("#track-choice");
    const ended = await fetch(`${url}/v1/tracks/${id}`, { method: "DELETE" });
    assert.equal(ended.status, 204);
    await trackStatus(`Track ${id} has ended. Its 2 frames stay here`);
    // They can still be looked through.
    await page.focus("#track-slider");
    await page.keyboard.press("ArrowLeft");
    await trackStatus("at frame 1");
    for (const button of ["#save-track", "#follow"]) {
      await page.evaluate(() => { document.getElementById("track-status").textContent = ""; });
      await page.click(button);
      await trackStatus(`The service does not have track ${id} any more.`);
    }
  });

  await check("no error in the console, no request to another host", async () => {
    // Chromium itself reports responses of status 4xx, which some checks ask for.
    const errors = seen.errors.filter((text) => !/the server responded with a status of (404|415|422|503)/.test(text) && !/GPU stall|swiftshader|WebGL/i.test(text));
    assert.deepEqual(errors, []);
    assert.deepEqual([...seen.hosts], [new URL(url).origin]);
  });

  await check("phone width and dark", async () => {
    const phone = await browser.newPage({ viewport: { width: 360, height: 740 }, colorScheme: "dark" });
    await phone.goto(url);
    await phone.waitForFunction(() => window.grimnet?.map.loaded(), null, { timeout });
    for (const width of [320, 360, 390]) {
      await phone.setViewportSize({ width, height: 740 });
      // The whole page, and what scrolls in it.
      const wide = await phone.evaluate(() => Math.max(...["html", "main", "#panel"].map((name) => document.querySelector(name).scrollWidth)));
      assert.ok(wide <= width, `${wide} px wide on a screen of ${width} px`);
    }
    await phone.setViewportSize({ width: 360, height: 740 });
    await phone.screenshot({ path: path.join(out, "phone_dark.png") });
    await phone.close();
  });

  await check("without WebGL there is a message, and photos are located", async () => {
    const plain = await browser.newPage();
    await plain.addInitScript(() => {
      const getContext = HTMLCanvasElement.prototype.getContext;
      HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
        return kind.startsWith("webgl") ? null : getContext.call(this, kind, ...rest);
      };
    });
    await plain.goto(url);
    await plain.waitForFunction(() => !document.getElementById("no-map").hidden, null, { timeout });
    await plain.setInputFiles("#files", files[0]);
    await status(plain, "within");
    await plain.close();
  });

  await check("a click on an answer and a track show their map, and photos are located on the one on which they were begun", async () => {
    const two = await browser.newPage();
    await two.goto(url);
    await two.waitForFunction(() => window.grimnet?.map.getLayer("picture"), null, { timeout });
    await two.setInputFiles("#files", files[0]);
    await status(two, "within");
    await two.selectOption("#map-choice", "other");
    await two.setInputFiles("#files", files[1]);
    await two.waitForFunction(() => document.querySelectorAll("#answers li").length === 2, null, { timeout });
    assert.ok((await two.textContent("#facts")).includes("other"));
    assert.equal(await two.inputValue("#map-choice"), "other");
    await two.click("#answers li:nth-child(2) button");
    await two.waitForFunction(() => document.getElementById("map-choice").value === "area" && document.getElementById("facts").textContent.includes("area"), null, { timeout });
    assert.equal(await two.getAttribute("#answers li:nth-child(2) button", "aria-pressed"), "true");
    await two.waitForFunction(() => window.grimnet.map.getSource("outlines")?.tiles?.[0].includes("/maps/area/"), null, { timeout });
    await two.click("#answers li:nth-child(1) button");
    await two.waitForFunction(() => document.getElementById("map-choice").value === "other", null, { timeout });
    await two.waitForFunction(() => window.grimnet.map.getSource("outlines")?.tiles?.[0].includes("/maps/other/"), null, { timeout });
    // A photo that is located meanwhile stays on its map.
    let go;
    const gate = new Promise((resolve) => {
      go = resolve;
    });
    await two.route("**/v1/locate*", async (route) => {
      await gate;
      await route.continue();
    });
    await two.setInputFiles("#files", files[2]);
    await two.click("#answers li:nth-child(2) button");
    await two.waitForFunction(() => document.getElementById("map-choice").value === "area" && document.getElementById("facts").textContent.includes("area"), null, { timeout });
    assert.equal(await two.getAttribute("#answers li:nth-child(2) button", "aria-pressed"), "true");
    await two.selectOption("#map-choice", "other");
    const track = await (await fetch(`${url}/v1/tracks`, { method: "POST", body: JSON.stringify({ map: "area" }) })).json();
    await two.click("#tracks summary");
    await two.click("#read-tracks");
    await two.waitForFunction(() => document.getElementById("track-choice").options.length > 0, null, { timeout });
    await two.selectOption("#track-choice", String(track.id));
    await two.click("#follow");
    await two.waitForFunction(() => document.getElementById("track-status").textContent.includes("no frame yet"), null, { timeout });
    await two.waitForFunction(() => document.getElementById("map-choice").value === "area", null, { timeout });
    go();
    await two.waitForFunction(() => document.querySelectorAll("#answers li").length === 3, null, { timeout });
    assert.ok((await two.textContent("#facts")).includes("other"));
    assert.equal(await two.inputValue("#map-choice"), "area");
    await two.click("#answers li:nth-child(1) button");
    await two.waitForFunction(() => document.getElementById("map-choice").value === "other", null, { timeout });
    await two.click("#answers li:nth-child(3) button");
    await two.waitForFunction(() => document.getElementById("map-choice").value === "area", null, { timeout });
    await two.close();
  });

  await check("the page to try the API sends a request", async () => {
    const api = await browser.newPage();
    await api.goto(`${url}/api`);
    const section = api.locator("section", { hasText: "/v1/maps" }).filter({ hasText: "Lists the maps" });
    await section.locator("button").click();
    await section.locator("pre", { hasText: "\"maps\"" }).waitFor({ timeout });
    await api.close();
  });

  await browser.close();
  console.log(`${passed} passed, 0 failed`);
}

main().catch((error) => {
  console.error(error);
  process.exit(1);
});
