// A form for each operation that /openapi.json describes.
const list = document.getElementById("operations");
const token = document.getElementById("token");

/** Characters of a response that are shown, at most. */
const MAX_SHOWN = 20000;

function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

function field(label, hint, input) {
  const parts = [label, input];
  if (hint) parts.push(element("span", { class: "hint" }, hint));
  return element("label", {}, ...parts);
}

// The inputs of one operation: parameters of path, query and header, then the body.
function inputsOf(operation) {
  const inputs = [];
  for (const parameter of operation.parameters ?? []) {
    const input = element("input", { name: parameter.name, "data-in": parameter.in });
    if (parameter.required) input.required = true;
    inputs.push(field(parameter.name, parameter.description, input));
  }
  const content = operation.requestBody?.content;
  if (content?.["multipart/form-data"]) {
    inputs.push(field("photo", "JPEG, PNG, TIFF or WebP", element("input", { type: "file", name: "photo", "data-in": "part", required: "" })));
    inputs.push(field("prior", 'JSON, such as {"heading": 90, "height_agl_m": 120}', element("textarea", { name: "prior", "data-in": "part", rows: "2" })));
  } else if (content?.["application/json"]) {
    inputs.push(field("body", "JSON", element("textarea", { name: "body", "data-in": "json", rows: "4" })));
  }
  const types = Object.keys(operation.responses?.["200"]?.content ?? {});
  if (types.length > 1) {
    const choice = element("select", { name: "accept", "data-in": "accept" }, ...types.map((type) => element("option", {}, type)));
    inputs.push(field("answer as", "", choice));
  }
  return inputs;
}

// Shows a response as it comes: events of a track end only with the track. Returns when all of it is there.
async function showBody(response, output) {
  const head = `${response.status} ${response.statusText}\n${response.headers.get("content-type") ?? ""}\n\n`;
  output.textContent = head;
  if (!response.body) return;
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    text += value;
    if (text.length > MAX_SHOWN) {
      output.textContent = `${head}${text.slice(0, MAX_SHOWN)}\n… (the rest is not shown)`;
      await reader.cancel();
      return;
    }
    output.textContent = head + text;
  }
}

async function send(method, path, form, output, signal) {
  const query = new URLSearchParams();
  const parts = new FormData();
  const headers = {};
  let body;
  let hasParts = false;
  for (const input of form.querySelectorAll("[data-in]")) {
    const value = input.type === "file" ? input.files[0] : input.value.trim();
    if (!value) continue;
    switch (input.dataset.in) {
      case "path": path = path.replace(`{${input.name}}`, encodeURIComponent(value)); break;
      case "header": headers[input.name] = value; break;
      case "query": query.append(input.name, value); break;
      case "part": parts.append(input.name, value); hasParts = true; break;
      case "json": body = value; headers["content-type"] = "application/json"; break;
      case "accept": headers.accept = value; break;
    }
  }
  if (hasParts) body = parts;
  if (token.value) headers.authorization = `Bearer ${token.value}`;
  output.textContent = "…";
  try {
    const search = query.size ? `?${query}` : "";
    const response = await fetch(path + search, { method: method.toUpperCase(), headers, body, signal });
    await showBody(response, output);
  } catch (error) {
    // Another request of this form took its place.
    if (signal.aborted) return;
    output.textContent = `The service cannot be reached: ${error.message}`;
  }
}

function card(method, path, operation) {
  const output = element("pre", { "aria-live": "polite", hidden: "" });
  const form = element("form", {}, ...inputsOf(operation), element("button", {}, "Send"));
  let sent = null;
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    output.hidden = false;
    sent?.abort();
    sent = new AbortController();
    send(method, path, form, output, sent.signal);
  });
  const title = element("h2", {}, element("span", { class: "method" }, method.toUpperCase()), ` ${path}`);
  const description = element("p", {}, operation.summary ?? "", element("br"), element("span", { class: "hint" }, operation.description ?? ""));
  return element("section", { class: "card", "aria-label": `${method} ${path}` }, title, description, form, output);
}

try {
  const response = await fetch("/openapi.json");
  const api = await response.json();
  const cards = [];
  for (const [path, operations] of Object.entries(api.paths)) {
    for (const [method, operation] of Object.entries(operations)) cards.push(card(method, path, operation));
  }
  list.replaceChildren(...cards);
} catch (error) {
  list.textContent = `The description cannot be read: ${error.message}`;
}
