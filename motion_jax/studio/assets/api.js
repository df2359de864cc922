// Requests to the studio. What it refuses becomes an Error with its sentence.

export const token = new URLSearchParams(location.search).get("token") ?? "";

async function ask(path, options = {}) {
  let reply;
  try {
    reply = await fetch(path, { ...options, headers: { ...options.headers, authorization: `Bearer ${token}` } });
  } catch {
    throw new Error("the studio does not answer; is it still running?");
  }
  if (reply.ok) return reply;
  const told = await reply.json().catch(() => null);
  throw new Error(told?.error?.message ?? `the studio answered with status ${reply.status}`);
}

const json = async (path, body) =>
  (
    await ask(path, { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) })
  ).json();

export const models = async () => (await (await ask("/v1/models")).json()).models;
export const body = async () => (await ask("/body.json")).json();
export const story = (request) => json("/v1/story", request);
export const edit = (request) => json("/v1/edit", request);
export const project = (value) => json("/v1/project", value);

export async function importFile(file) {
  const name = encodeURIComponent(file.name);
  return (await (await ask(`/v1/import?name=${name}`, { method: "POST", body: file })).json()).motion;
}

/** {blob, name} of a motion as a file. */
export async function exportMotion(request) {
  const reply = await ask("/v1/export", { method: "POST", body: JSON.stringify(request) });
  const name = /filename="([^"]*)"/.exec(reply.headers.get("content-disposition") ?? "")?.[1];
  return { blob: await reply.blob(), name: name ?? `motion.${request.format}` };
}

export function download(blob, name) {
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: name });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}
