// The service's API, as the page uses it.

/** Times that a photo is sent to a busy service. */
const MAX_TRIES = 10;

/** An error that the service states (RFC 9457), or that it cannot be reached, or a photo not be read. */
export class ServiceError extends Error {
  /** `retryAfterS`: seconds after which a busy service wants to be asked again, or null. */
  constructor(message, status = 0, retryAfterS = null) {
    super(message);
    this.status = status;
    this.retryAfterS = retryAfterS;
  }
}

/** Sends a request with the token, and returns the response if it is a good one. */
export async function ask(path, token, options = {}) {
  const headers = { ...options.headers };
  if (token) headers.authorization = `Bearer ${token}`;
  let response;
  try {
    response = await fetch(path, { ...options, headers });
  } catch {
    throw new ServiceError("The service cannot be reached.");
  }
  if (response.ok) return response;
  const problem = await response.json().catch(() => ({}));
  const retryAfterS = response.status === 503 ? Number.parseInt(response.headers.get("retry-after"), 10) : Number.NaN;
  throw new ServiceError(
    problem.detail ?? `${response.status} ${response.statusText}`,
    response.status,
    Number.isFinite(retryAfterS) ? retryAfterS : null,
  );
}

/** As `ask`, for the JSON of the response: it may break off, or come from another one, such as the login page of a proxy. */
export async function askJson(path, token, options = {}) {
  const response = await ask(path, token, options);
  try {
    return await response.json();
  } catch {
    throw new ServiceError("The answer broke off, or is not the service's.");
  }
}

/** Saves data as a file of the user's. */
export function saveAs(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

/** Lists options to choose from; the chosen one stays the chosen one where it is listed again. */
export function listOptions(choice, options) {
  const before = choice.value;
  choice.replaceChildren(...options);
  if (options.some(({ value }) => value === before)) choice.value = before;
}

/** Throws if the browser cannot read a file: sending it would fail as if there were no service. */
async function checkReadable(file) {
  try {
    await file.slice(0, 1).arrayBuffer();
  } catch {
    throw new ServiceError("This browser cannot read it: it is a folder, or was changed or removed after it was chosen. Choose the photo again.");
  }
}

/**
 * Localises one photo. `prior` holds texts by field; empty ones are left out. `onBusy` is called with the error of a busy service,
 * which is asked again after `retryAfterS` seconds.
 */
export async function locate(file, map, prior, token, onBusy) {
  const known = {};
  for (const [name, text] of Object.entries(prior)) {
    const trimmed = text.trim();
    if (!trimmed) continue;
    const number = Number(trimmed);
    known[name] = Number.isFinite(number) ? number : trimmed;
  }
  const body = new FormData();
  body.append("prior", JSON.stringify(known));
  body.append("photo", file, file.name);
  // The name here, too: browsers write quotes and line ends in names of files as %22 and so on into a form.
  const query = new URLSearchParams({ map, detail: "true", name: file.name });
  for (let tries = 1; ; tries++) {
    try {
      await checkReadable(file);
      return await askJson(`/v1/locate?${query}`, token, { method: "POST", body });
    } catch (error) {
      if (!(error instanceof ServiceError) || error.retryAfterS === null || tries === MAX_TRIES) throw error;
      onBusy(error);
      await new Promise((resolve) => setTimeout(resolve, 1000 * error.retryAfterS));
    }
  }
}
