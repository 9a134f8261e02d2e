// The service's API, as the page uses it.

/** An error that the service states (RFC 9457), or that it cannot be reached. */
export class ServiceError extends Error {
  constructor(message, status = 0) {
    super(message);
    this.status = status;
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
  throw new ServiceError(problem.detail ?? `${response.status} ${response.statusText}`, response.status);
}

/** Saves data as a file of the user's. */
export function saveAs(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

/** Localises one photo. `prior` holds texts by field; empty ones are left out. */
export async function locate(file, map, prior, token) {
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
  const query = new URLSearchParams({ map, detail: "true" });
  const response = await ask(`/v1/locate?${query}`, token, { method: "POST", body });
  return response.json();
}
